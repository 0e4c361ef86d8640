"""Line segments of a capture, by line-based multi-view stereo."""

from collections.abc import Callable, Iterable
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.growth import GrowthConfig, orient_segments
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct
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
    views = capture.views_on(device)
    # Guesses mislead the flow that first strands are traced through; lines that little more than one other view
    # confirms are rarely wrong, and the flow needs them.
    config = LmvsConfig(confirming=1.4, complete="never")
    found = reconstruct(views, head.mesh.to(device), config, random, work, track).to("cpu")
    return orient_segments(found, head.mesh, head.scalp_faces, [], GrowthConfig())
