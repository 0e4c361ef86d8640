"""What line-based multi-view stereo needs of a view: a camera, and images that are read only when their turn comes."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import cv2
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera


@dataclass(frozen=True)
class View:
    """One photograph and where it was taken from.

    Attributes:
        camera: calibrated, without lens distortion; its name is what messages and files call the view.
        load_image: reads the photograph, sRGB in [0, 1].
        load_mask: reads the coverage of hair in [0, 1]; None where the capture has no masks.
    """

    camera: Camera
    load_image: Callable[[], Float[Tensor, "height width 3"]]
    load_mask: Callable[[], Float[Tensor, "height width"]] | None = None


def reduced(view: View, longest: int) -> View:
    """The view with at most `longest` pixels along its longer side; smaller ones stay as they are."""
    camera = view.camera
    scale = longest / max(camera.width, camera.height)
    if scale >= 1:
        return view
    width, height = max(round(scale * camera.width), 1), max(round(scale * camera.height), 1)
    load_mask = None if view.load_mask is None else partial(_load_reduced, view.load_mask, width, height)
    return View(camera.resized(width, height), partial(_load_reduced, view.load_image, width, height), load_mask)


def _load_reduced(load: Callable[[], Tensor], width: int, height: int) -> Tensor:
    """An image averaged over the areas of its new pixels."""
    return torch.from_numpy(cv2.resize(load().cpu().numpy(), (width, height), interpolation=cv2.INTER_AREA))
