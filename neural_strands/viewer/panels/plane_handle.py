"""A plane in space that a person drags to say where hair is cut."""

from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import quaternion_to_matrix

if TYPE_CHECKING:
    import viser

NAME = "/cutting_plane"
SIZE = 0.34
"""Side of the sheet that shows the plane, metres."""
HANDLE = 0.14
"""Length of the arrows that drag it, metres."""
COLOUR = (66, 133, 244)


class PlaneHandle:
    """A sheet with arrows; what lies below it, on the side of its own -y, is to be cut."""

    def __init__(self, server: "viser.ViserServer", middle: tuple[float, float, float]) -> None:
        """Put it level through a point."""
        self._handle = server.scene.add_transform_controls(NAME, scale=HANDLE, position=middle, depth_test=False)
        half = SIZE / 2
        corners = np.array([[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]], np.float32)
        faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
        # The usual material takes a browser without a graphics card many seconds to compile.
        server.scene.add_mesh_simple(
            f"{NAME}/sheet", corners, faces, color=COLOUR, opacity=0.35, material="toon3", side="double"
        )

    def place(self) -> tuple[float, float, float, float, float, float]:
        """A point of the plane and the normal towards what is cut, as a haircut takes them."""
        return plane_of(tuple(self._handle.position.tolist()), tuple(self._handle.wxyz.tolist()))

    def remove(self) -> None:
        """Take it away."""
        self._handle.remove()


def plane_of(
    position: tuple[float, float, float], wxyz: tuple[float, float, float, float]
) -> tuple[float, float, float, float, float, float]:
    """A point of a sheet and its own -y axis in the world.

    Args:
        position: its middle, world metres.
        wxyz: its rotation to the world as a quaternion.
    """
    normal = -quaternion_to_matrix(torch.tensor(wxyz, dtype=torch.float64))[:, 1]
    x, y, z = normal.tolist()
    return (*position, x, y, z)


def middle_of(points: Float[Tensor, "strand point 3"]) -> tuple[float, float, float]:
    """Where the plane starts: between the middle of the hair and its lower end."""
    flat = points.reshape(-1, 3)
    flat = flat[flat.isfinite().all(dim=1)]
    low, high = flat.amin(dim=0), flat.amax(dim=0)
    x, y, z = (0.5 * (low + high)).tolist()
    return x, 0.5 * (y + float(low[1])), z
