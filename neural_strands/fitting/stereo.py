"""Line segments of a capture by line-based multi-view stereo, and a check of segments from a file."""

from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.hold_out import held_out_views
from neural_strands.fitting.config import FitConfig
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.files import SegmentsSource
from neural_strands.lmvs.growth import orient_segments
from neural_strands.lmvs.reconstruct import reconstruct
from neural_strands.scalp.head import Head


def find_segments(
    capture: Capture,
    head: Head,
    config: FitConfig,
    work: Path | None,
    track: Callable[[Iterable, str, int], Iterable],
    device: torch.device | str = "cpu",
) -> LineSegments:
    """Reconstruct segments from these views, signed from root to tip, on the CPU.

    Args:
        capture: the views that may be used.
        head: the head in the cameras' frame; hair grows away from its scalp, not from its shoulders.
        config: the settings of stereo and growth directions, and the seed.
        work: folder for finished views, from which a stopped run continues; None stores nothing.
        track: shows progress of a loop.
        device: device of the stereo; growth directions are computed on the CPU.
    """
    random = torch.Generator().manual_seed(config.seed)
    views = capture.views_on(device)
    found = reconstruct(views, head.mesh.to(device), config.stereo, random, work, track).to("cpu")
    return orient_segments(found, head.mesh, head.scalp_faces, [], config.growth)


def segments_source(capture: Capture, config: FitConfig) -> SegmentsSource:
    """Views and settings from which `find_segments` makes segments, to be stored with them."""
    names = tuple(camera.name for camera in capture.cameras)
    settings = {"stereo": asdict(config.stereo), "growth": asdict(config.growth), "seed": config.seed}
    return SegmentsSource(names, settings)


def check_source(path: Path, source: SegmentsSource | None, capture: Capture, every: int) -> str | None:
    """Refuse segments made from views that the fit holds out: they would bias the scores on those views.

    Args:
        path: file of the segments.
        source: the views and settings that the file records, if it does.
        capture: all views.
        every: one view in this many is held out; 0 holds out none.

    Returns:
        A warning if the file does not record its views and some are held out, else None.

    Raises:
        InputError: at least one held-out view was used.
    """
    held_out = [capture.cameras[index].name for index in held_out_views(len(capture), every)]
    if source is None:
        if not held_out:
            return None
        return (
            f"warning: {path} does not name the views that its segments were made from; if the {len(held_out)} views "
            "that this fit holds out were among them, its scores are too good."
        )
    used = sorted(set(held_out) & set(source.views))
    if used:
        raise InputError(
            f"{path}: expected segments made without the views that the fit holds out, found {len(used)} of these "
            f"{len(held_out)} among them, {used[0]} first; run lmvs with --hold-out-every {every}, or let the fit "
            "compute the segments itself."
        )
    return None
