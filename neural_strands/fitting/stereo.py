"""Line segments of a capture, by line-based multi-view stereo."""

from collections.abc import Callable, Iterable
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.fitting.config import FitConfig
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.growth import orient_segments
from neural_strands.lmvs.reconstruct import reconstruct
from neural_strands.scalp.head import Head


def find_segments(
    capture: Capture,
    head: Head,
    config: FitConfig,
    work: Path,
    track: Callable[[Iterable, str, int], Iterable],
    device: torch.device | str = "cpu",
) -> LineSegments:
    """Segments of these views, signed from root to tip, on the CPU.

    Args:
        capture: the views that may be used.
        head: the head in the cameras' frame; hair grows away from its scalp, not from its shoulders.
        config: the settings of stereo and growth directions, and the seed.
        work: folder for finished views, so that a stopped run continues.
        track: shows progress of a loop.
        device: where the stereo is computed; growth directions are computed on the CPU.
    """
    random = torch.Generator().manual_seed(config.seed)
    views = capture.views_on(device)
    found = reconstruct(views, head.mesh.to(device), config.stereo, random, work, track).to("cpu")
    return orient_segments(found, head.mesh, head.scalp_faces, [], config.growth)
