"""A plane in space that the user drags to choose where hair is cut."""

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
"""Length of the arrows for dragging it, metres."""
COLOUR = (66, 133, 244)


class PlaneHandle:
    """A sheet with arrows; hair below it, on the side of its -y axis, is cut."""

    def __init__(self, server: "viser.ViserServer", middle: tuple[float, float, float]) -> None:
        """Place it horizontally through a point."""
        self._handle = server.scene.add_transform_controls(NAME, scale=HANDLE, position=middle, depth_test=False)
        half = SIZE / 2
        corners = np.array([[-half, 0, -half], [half, 0, -half], [half, 0, half], [-half, 0, half]], np.float32)
        faces = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
        # Without a graphics card, a browser takes many seconds to compile the default material.
        server.scene.add_mesh_simple(
            f"{NAME}/sheet", corners, faces, color=COLOUR, opacity=0.35, material="toon3", side="double"
        )

    def place(self) -> tuple[float, float, float, float, float, float]:
        """A point of the plane and the normal towards the cut hair, in the format of `Haircut.plane`."""
        return plane_of(tuple(self._handle.position.tolist()), tuple(self._handle.wxyz.tolist()))

    def remove(self) -> None:
        """Remove it from the scene."""
        self._handle.remove()


def plane_of(
    position: tuple[float, float, float], wxyz: tuple[float, float, float, float]
) -> tuple[float, float, float, float, float, float]:
    """A point of a sheet and its -y axis in the world.

    Args:
        position: middle of the sheet, world metres.
        wxyz: rotation from the sheet to the world, as a quaternion.
    """
    normal = -quaternion_to_matrix(torch.tensor(wxyz, dtype=torch.float64))[:, 1]
    x, y, z = normal.tolist()
    return (*position, x, y, z)


def middle_of(points: Float[Tensor, "strand point 3"]) -> tuple[float, float, float]:
    """Initial position of the plane: halfway between the middle of the hair and its lower end."""
    flat = points.reshape(-1, 3)
    flat = flat[flat.isfinite().all(dim=1)]
    low, high = flat.amin(dim=0), flat.amax(dim=0)
    x, y, z = (0.5 * (low + high)).tolist()
    return x, 0.5 * (y + float(low[1])), z
