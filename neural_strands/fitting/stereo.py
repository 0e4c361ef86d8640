"""Line segments of a capture, by line-based multi-view stereo."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.growth import GrowthConfig, orient_segments
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct
from neural_strands.lmvs.views import View
from neural_strands.scalp.head import Head


def find_segments(
    capture: Capture,
    head: Head,
    seed: int,
    work: Path,
    track: Callable[[Iterable, str, int], Iterable],
    device: torch.device | str = "cpu",
) -> LineSegments:
    """Segments of these views, signed from root to tip, on the CPU.

    Args:
        capture: the views that may be seen.
        head: the head in the cameras' frame; hair grows away from its scalp, not from its shoulders.
        seed: of every random choice.
        work: folder where finished views are kept, so that a stopped run goes on.
        track: shows progress of a loop.
        device: where the stereo is computed; growth directions are the CPU's.
    """
    random = torch.Generator().manual_seed(seed)
    views = [moved(view, device) for view in capture_views(capture)]
    # Guesses mislead the flow that first strands are traced through; lines that little more than one other view
    # confirms are rarely wrong, and the flow needs them.
    config = LmvsConfig(confirming=1.4, complete="never")
    found = reconstruct(views, head.mesh.to(device), config, random, work, track).to("cpu")
    return orient_segments(found, head.mesh, head.scalp_faces, [], GrowthConfig())


def capture_views(capture: Capture) -> list[View]:
    """The capture's photographs as line-based stereo takes them: nothing is read before its turn."""
    return [
        View(camera, partial(capture.image, index), _mask_loader(capture, index))
        for index, camera in enumerate(capture.cameras)
    ]


def moved(view: View, device: torch.device | str) -> View:
    """The view with its camera, and what it reads, on `device`."""
    load_mask = None if view.load_mask is None else partial(_read_to, view.load_mask, device)
    return View(view.camera.to(device), partial(_read_to, view.load_image, device), load_mask)


def _read_to(load: Callable[[], Tensor], device: torch.device | str) -> Tensor:
    """What a loader reads, on `device`."""
    return load().to(device)


def _mask_loader(capture: Capture, index: int) -> Callable[[], Float[Tensor, "height width"]] | None:
    """How to read a view's hair mask, if it has one."""
    if capture.views[index].hair_mask_path is None:
        return None

    def load() -> Float[Tensor, "height width"]:
        mask = capture.hair_mask(index)
        if mask is None:
            raise ValueError(f"view {index} lost its mask")
        return mask

    return load
