"""Pictures of the hair for one browser: rendered, as a photograph, or both side by side."""

from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float32, UInt8

from neural_strands.geometry.cameras import Camera
from neural_strands.model.picture_depth import picture_depth
from neural_strands.model.renderer import HairRenderer
from neural_strands.pictures.encoding import to_bytes

LINE = 400
"""Width of a picture divided by that of the line between two pictures."""
Pixels = UInt8[np.ndarray, "height width 3"]


class Frame(NamedTuple):
    """A picture, with the depth by which a browser hides what it draws itself behind the picture's hair and body.

    Attributes:
        picture: sRGB-encoded.
        depth: metres along the optical axis (`picture_depth`); None if everything else is in front of the picture.
    """

    picture: Pixels
    depth: Float32[np.ndarray, "height width"] | None = None


def rendered(renderer: HairRenderer, camera: Camera, with_depth: bool = False) -> Frame:
    """The hair over body and background, and its depth if that is needed."""
    output = renderer.render(camera)
    return Frame(to_bytes(output.rgb), picture_depth(output).float().cpu().numpy() if with_depth else None)


def seen_by(
    photograph: UInt8[np.ndarray, "taken_height taken_width 3"], taken: Camera, camera: Camera, behind: Pixels
) -> Pixels:
    """A photograph as seen by another camera with the same pose, composited over `behind`.

    Args:
        photograph: the photograph, sRGB-encoded.
        taken: camera of the photograph.
        camera: the other one; only its intrinsics and size may differ.
        behind: picture, of the other camera's size, that shows where the photograph has no pixels.
    """
    change = (camera.intrinsics @ torch.linalg.inv(taken.intrinsics)).double().cpu().numpy()
    # Our pixel centres are at +0.5, OpenCV's at integers.
    shift = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    warp = (np.linalg.inv(shift) @ change @ shift)[:2]
    size = (camera.width, camera.height)
    smaller = np.sqrt(abs(np.linalg.det(warp[:, :2])))
    if smaller < 1:
        # Each pixel of the result covers several of the photograph.
        photograph = cv2.GaussianBlur(photograph, (0, 0), 0.5 * np.sqrt(1 / smaller**2 - 1) + 1e-3)
    warped = cv2.warpAffine(photograph, warp, size, flags=cv2.INTER_LINEAR)
    inside = cv2.warpAffine(np.ones(photograph.shape[:2], np.float32), warp, size)[..., None]
    return np.where(inside > 0.999, warped, behind)


def wiped(left: Pixels, right: Pixels, share: float) -> Pixels:
    """One picture up to `share` of the width, the other beyond, with a thin white line in between."""
    column, width = round(share * left.shape[1]), left.shape[1]
    picture = np.concatenate([left[:, :column], right[:, column:]], axis=1)
    if 0 < column < width:
        picture[:, column - max(width // LINE, 1) : column] = 255
    return picture
