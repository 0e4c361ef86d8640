"""A folder as examples expect it: a small capture, its line segments, and a run of a few steps."""

from dataclasses import replace
from pathlib import Path

from tiny_capture import tiny_config, true_segments, write_capture

import neural_strands as ns
from neural_strands.lmvs.files import SegmentsSource, save_segments

VIEWS = 10


def write_workspace(folder: Path) -> None:
    """Write `capture`, `segments.npz` (of the training views) and `run` into a folder."""
    segments = true_segments(write_capture(folder / "capture", views=VIEWS))
    seen = tuple(f"{view:03d}.png" for view in range(VIEWS) if view % 5 != 4)
    save_segments(folder / "segments.npz", segments, SegmentsSource(seen))
    config = replace(tiny_config(), steps=2, initialise="mean")
    ns.fit(folder / "capture", folder / "run", config, segments=folder / "segments.npz")
