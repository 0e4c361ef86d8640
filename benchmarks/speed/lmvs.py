"""Line-based multi-view stereo: time and memory of a capture end to end, and its score against the ground truth.

    python benchmarks/speed/lmvs.py CAPTURE OUT [--keep] [--device cuda]
    python benchmarks/speed/lmvs.py CAPTURE OUT --views 10 20 40 --sides 128 256 512

OUT/work is emptied first unless --keep is given. With `--views` or `--sides`, a table shows instead how the cost grows
with the number of views, spread evenly over the capture, and with the longer side of the photographs, reduced if they
are larger; numbers that the capture does not have are left out.
"""

import math
import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import torch
import tyro
from beside import table

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import read_head
from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.foundation.memory import peak_resident_memory
from neural_strands.foundation.progress import track
from neural_strands.geometry.point_queries import match_levels
from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.geometry.strands import directions, lengths
from neural_strands.lmvs.files import save_segments
from neural_strands.lmvs.growth import GrowthConfig, orient_segments
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct

THRESHOLDS = [(0.001, 0.17453), (0.002, 0.34907), (0.003, 0.5236)]
STEP = 0.0005


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    keep: bool = False
    """Reuse results of an earlier run in OUT/work."""
    device: DeviceName = "cpu"
    """Device."""
    views: tuple[int, ...] = ()
    """Numbers of views."""
    sides: tuple[int, ...] = ()
    """Longer sides of the photographs, pixels."""


def spread(count: int, among: int) -> list[int]:
    """So many indices, spread evenly."""
    return [place * among // count for place in range(count)]


def growth(given: Arguments, capture: Capture, device: torch.device) -> str:
    """A row for every number of views, at full size, and for every side, with all views."""
    side = max(max(camera.width, camera.height) for camera in capture.cameras)
    views = sorted({count for count in given.views if count < len(capture)} | {len(capture)})
    sides = sorted(length for length in given.sides if length < side)
    settings = [(count, side) for count in views] + [(len(capture), length) for length in sides]
    file = read_head(capture)
    head = None if file is None else file.mesh.to(device)
    rows = []
    for count, length in settings:
        chosen = capture.subset(spread(count, len(capture))).views_on(device).reduced(length)
        begin = time.perf_counter(), time.process_time()
        found = reconstruct(chosen, head, LmvsConfig(), torch.Generator().manual_seed(0)).to("cpu")
        wall, processor = time.perf_counter() - begin[0], time.process_time() - begin[1]
        rows.append((count, length, wall, processor, processor / count, len(found)))
    return table(("views", "side", "wall s", "processor s", "a view", "points"), rows)


def main(given: Arguments) -> None:
    device = pick_device(given.device)
    if given.views or given.sides:
        print(growth(given, Capture.load(given.capture), device))
        return
    if not given.keep:
        shutil.rmtree(given.out / "work", ignore_errors=True)
    capture = Capture.load(given.capture)
    begin = time.perf_counter(), time.process_time()
    generator = torch.Generator().manual_seed(0)
    views = capture.views_on(device)
    file = read_head(capture)
    head, scalp = (None, None) if file is None else (file.mesh, file.scalp_faces)
    there = None if head is None else head.to(device)
    # Copying to the CPU waits for the device before the clock is read.
    segments = reconstruct(views, there, LmvsConfig(), generator, given.out / "work", track).to("cpu")
    segments = orient_segments(segments, head, scalp, [], GrowthConfig())
    wall, processor = time.perf_counter() - begin[0], time.process_time() - begin[1]
    memory = peak_resident_memory() / 2**20
    save_segments(given.out / "segments.npz", segments)
    print(f"{len(capture)} views: {wall:.0f} s, {processor:.0f} s of processor, {memory:.0f} MB")
    print(f"{segments.segment_count} segments, {len(segments)} points")
    truth = capture.ground_truth
    if truth is None:
        return
    count = int(lengths(truth.points).max() / STEP) + 2
    points = resample_polyline_lengths(truth.points, count)
    lines = directions(points).reshape(-1, 3)
    points = points.reshape(-1, 3)
    pick = torch.randperm(len(points), generator=generator)[:50_000]
    unsigned, signed = match_levels(segments.points, segments.directions, points, lines, THRESHOLDS)
    recalled, _ = match_levels(points[pick], lines[pick], segments.points, segments.directions, THRESHOLDS)
    for level, (distance, angle) in enumerate(THRESHOLDS):
        precision, recall = float((unsigned <= level).float().mean()), float((recalled <= level).float().mean())
        score = 2 * precision * recall / max(precision + recall, 1e-9)
        print(
            f"{distance * 1000:.0f} mm, {math.degrees(angle):.0f} degrees: precision {100 * precision:.1f}, "
            f"recall {100 * recall:.1f}, F {100 * score:.1f}"
        )
    right = (signed <= 2).float().sum() / (unsigned <= 2).float().sum()
    print(f"growth direction right: {100 * float(right):.1f} % of the matched points")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
