"""The files of a view, and the lens of its photograph."""

from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.lens import Lens
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera

ROTATION_TOLERANCE = 1e-2
"""Largest deviation of a stored rotation from an orthonormal one (exports round to a few digits)."""
WORLD_TO_ROOM, TORSO = "world_to_room", "torso"
"""Keys of a frame in `transforms.json` for the motion of the person (`Camera`)."""
FARTHEST = 1e6
"""Largest distance of a camera from the origin; more is garbage in any unit."""


@dataclass(frozen=True)
class ViewFiles:
    """A calibrated photograph and its masks on disk.

    Attributes:
        camera: the pinhole camera of the undistorted image.
        lens: the lens of the photograph.
        image_path: the photograph.
        hair_mask_path: coverage of hair, if there is a file.
        person_mask_path: coverage of the person, if there is a file.
    """

    camera: Camera
    lens: Lens
    image_path: Path
    hair_mask_path: Path | None = None
    person_mask_path: Path | None = None


def undistorted_intrinsics(lens: Lens) -> Float[Tensor, "3 3"]:
    """Intrinsics of the undistorted image."""
    return torch.from_numpy(lens.undistorted_matrix()).float()


def rigid(matrix: Float[Tensor, "4 4"], source: str) -> Float[Tensor, "4 4"]:
    """Check that a matrix is a rotation and a translation, and return it with an exactly orthonormal rotation.

    Raises:
        InputError: a value is not finite or absurd, or the matrix scales, shears or mirrors.
    """
    rotation = matrix[:3, :3]
    off = (rotation @ rotation.T - torch.eye(3, dtype=matrix.dtype)).abs().max()
    near = bool(matrix[:3, 3].abs().max() < FARTHEST)
    if not torch.isfinite(matrix).all() or not near or off > ROTATION_TOLERANCE or torch.linalg.det(rotation) < 0:
        raise InputError(
            f"{source}: expected a rigid camera pose (rotation and translation), found one that is not finite, scales, "
            "shears, mirrors or is absurdly far away; export the poses again."
        )
    left, _, right = torch.linalg.svd(rotation)
    exact = matrix.clone()
    exact[:3, :3] = left @ right
    exact[3] = matrix.new_tensor([0.0, 0.0, 0.0, 1.0])
    return exact


def find_mask(folder: Path, view: str) -> Path | None:
    """Find the mask of a view, in the sub-folder of its photograph: NAME.png, or NAME.jpg.png in COLMAP's style.

    Args:
        folder: `masks` or `person_masks`.
        view: the view's name, such as "left/0001.jpg".
    """
    place = PurePosixPath(view)
    names = (place.parent / f"{place.stem}.png", f"{view}.png", view)
    return next((folder / name for name in names if (folder / name).is_file()), None)
