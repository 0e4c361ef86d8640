"""Line segments of a capture by line-based multi-view stereo, and a check of segments from a file."""

from collections.abc import Iterable
from dataclasses import asdict, replace
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.hold_out import held_out_views
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.first_strands import find_course, hair_roots
from neural_strands.fitting.noise import noisy
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import Track
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.views import Views
from neural_strands.lmvs.files import SegmentsSource
from neural_strands.lmvs.growth import orient_segments
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct
from neural_strands.scalp.head import Head

WIDE = "wide"
"""Folder, in that of the stereo, of the views matched with the wide window."""


def find_segments(
    capture: Capture,
    head: Head,
    config: FitConfig,
    work: Path | None,
    track: Track,
    device: torch.device | str = "cpu",
) -> LineSegments:
    """Reconstruct segments from these views, signed from root to tip, on the CPU.

    If noise hides the streaks of straight hair, the stereo runs a second time with a wide window (see `noise`).

    Args:
        capture: the views that may be used.
        head: the head in the cameras' frame; hair grows away from its scalp, not from its shoulders.
        config: the settings of stereo and growth directions, and the seed.
        work: folder for finished views, from which a stopped run continues; None stores nothing.
        track: shows progress of a loop.
        device: device of the stereo; growth directions are computed on the CPU.
    """
    views = capture.views_on(device)
    there = head.to(device)
    found = _segments(views, there, config, config.stereo, work, track)
    if not noisy(views, config.stereo.orientation, config.noise) or not _straight(views, there, config, found, track):
        return found
    wide = replace(config.stereo.orientation, window=config.noise.window)

    def track_again(items: Iterable, title: str, total: int) -> Iterable:
        return track(items, f"{title}, noisy photographs of straight hair", total)

    stereo = replace(config.stereo, orientation=wide)
    return _segments(views, there, config, stereo, None if work is None else work / WIDE, track_again)


def _segments(
    views: Views,
    head: Head,
    config: FitConfig,
    stereo: LmvsConfig,
    work: Path | None,
    track: Track,
) -> LineSegments:
    """Segments, signed from root to tip, on the CPU."""
    random = torch.Generator().manual_seed(config.seed)
    found = reconstruct(views, head.mesh, stereo, random, work, track).to("cpu")
    head = head.to("cpu")
    return orient_segments(found, head.mesh, head.scalp_faces, [], config.growth)


def _straight(views: Views, head: Head, config: FitConfig, segments: LineSegments, track: Track) -> bool:
    """Whether the hair shows neither curls nor waves."""
    if not len(segments.points):
        return True
    device, random = head.mesh.vertices.device, torch.Generator().manual_seed(config.seed)
    roots = hair_roots(head, config.strands, views, config.initial.hull, random).to(device)
    return find_course(head, segments.to(device), views, roots, config.initial, None, track).curls is None


def segments_source(capture: Capture, config: FitConfig) -> SegmentsSource:
    """Views and settings from which `find_segments` makes segments, to be stored with them."""
    names = tuple(camera.name for camera in capture.cameras)
    settings = {
        "stereo": asdict(config.stereo),
        "noise": asdict(config.noise),
        "growth": asdict(config.growth),
        "seed": config.seed,
    }
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
