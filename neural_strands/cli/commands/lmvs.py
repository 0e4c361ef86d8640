"""`neural-strands lmvs`: line segments of the hair from a capture's photographs."""

import math
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from neural_strands.capture.hold_out import training_views
from neural_strands.cli.device import DeviceName, pick_device, seeded
from neural_strands.cli.streams import print_json, say
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track

SMALLEST_SIZE = 32
"""Smallest longer side of a photograph that shows more than a few streaks, pixels."""


@dataclass(frozen=True)
class Lmvs:
    """Reconstruct 3D line segments of the hair, with a growth direction, from a capture.

    Writes OUT/segments.npz, OUT/segments.ply (MeshLab, Blender) and pictures in OUT/report. A stopped run continues
    when the same command is given again.
    """

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture: images, calibration and, optionally, hair masks and a head."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder for the results."""
    head: Path | None = None
    """Head mesh in the cameras' frame, metres, instead of the capture's own; scalp_faces.json beside it is used."""
    strokes: Path | None = None
    """Polylines drawn from root to tip that override the growth direction: JSON, a list of {"points": [[x, y, z], ...]}
    in world metres or {"view": NAME, "points": [[x, y], ...]} in pixels of a view."""
    views: tuple[int, ...] | None = None
    """Use only these photographs, counted from 0. Default: all."""
    hold_out_every: Annotated[int, Between(0, 1_000_000)] = 0
    """Leave out one photograph in this many, the last of each group, as `fit` does for its evaluation; 0 leaves out
    none. Segments for `fit --segments` need the number that the fit uses: 5, unless its settings were changed."""
    confirming: Annotated[float, Between(0, 100)] = 2.0
    """Number of other views that must confirm a line. With fewer, segments cover more of the hair, and fewer of them
    are correct. The stereo of `fit` asks for 1.4 and fills no gaps (`--complete never`)."""
    size: int | None = None
    """Reduce photographs to at most this many pixels along the longer side: half the size takes a quarter of the time
    and gives coarser segments. Default: full size."""
    complete: Literal["auto", "always", "never"] = "auto"
    """Fill the gaps between lines that several views confirm with lines that only one view sees, thinned and with
    confidence 0.1. This covers far more of the hair, but fewer points are correct. auto: fill if confirmed lines come
    within 3 mm of less than a third of the space that masks and head leave for hair, and report it. Needs hair
    masks."""
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)
    """Direction against gravity, in the capture's axes: hair hangs down where nothing else determines its growth."""
    seed: int = 0
    """Seed of all random numbers."""
    device: DeviceName = "auto"
    """Where to compute."""
    json: bool = False
    """Print one JSON object instead of a sentence."""

    def run(self) -> None:
        """Reconstruct, orient, write."""
        from neural_strands.capture.capture import Capture
        from neural_strands.capture.head import read_head
        from neural_strands.capture.mask_agreement import with_judged_masks
        from neural_strands.lmvs.files import SegmentsSource, save_segments
        from neural_strands.lmvs.growth import GrowthConfig, orient_segments
        from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct
        from neural_strands.lmvs.report import write_pictures
        from neural_strands.lmvs.strokes import lift_stroke, read_strokes

        if not 0 < math.hypot(*self.up) < math.inf:
            raise InputError(f"--up: expected three finite numbers that are not all zero, found {self.up}.")
        if self.size is not None and self.size < SMALLEST_SIZE:
            raise InputError(f"--size: expected {SMALLEST_SIZE} pixels or more, found {self.size}.")
        begin = time.perf_counter()
        capture = Capture.load(self.capture)
        capture = capture.subset(self._seen(len(capture)))
        # Read before the long stereo run, lifted to 3D after it.
        drawn = [] if self.strokes is None else read_strokes(self.strokes, capture.cameras)
        device = pick_device(self.device)
        file = read_head(capture, self.head)
        head, scalp = (None, None) if file is None else (file.mesh, file.scalp_faces)
        capture = with_judged_masks(capture, range(len(capture)), head, say)
        views = capture.views_on(device)
        if self.size is not None:
            views = views.reduced(self.size)
        config = LmvsConfig(confirming=self.confirming, complete=self.complete)
        there = None if head is None else head.to(device)
        segments = reconstruct(views, there, config, seeded(self.seed), self.out / "work", track).to("cpu")
        strokes = [lift_stroke(stroke, segments) for stroke in drawn]
        x, y, z = (axis / math.hypot(*self.up) for axis in self.up)
        growth = GrowthConfig()
        segments = orient_segments(segments, head, scalp, strokes, growth, (x, y, z))
        settings = {"stereo": asdict(config), "growth": asdict(growth), "seed": self.seed}
        settings |= {"size": self.size, "up": self.up, "strokes": len(strokes)}
        source = SegmentsSource(tuple(camera.name for camera in capture.cameras), settings)
        for suffix in ("npz", "ply"):
            save_segments(self.out / f"segments.{suffix}", segments, source)
        write_pictures(views, head, segments, self.out)
        result = {
            "points": len(segments),
            "segments": segments.segment_count,
            "seconds": round(time.perf_counter() - begin, 1),
            "file": str(self.out / "segments.npz"),
        }
        if self.json:
            print_json(result)
        else:
            sys.stdout.write("{segments} segments, {points} points, {seconds} s: {file}\n".format(**result))

    def _seen(self, count: int) -> list[int]:
        """Indices of the views that stereo may use.

        Raises:
            InputError: `--views` asks for one that is not there.
        """
        seen = training_views(count, self.hold_out_every)
        if self.views is None:
            return seen
        for index in self.views:
            if not 0 <= index < count:
                raise InputError(f"--views: expected numbers from 0 to {count - 1}, found {index}.")
        return [index for index in self.views if index in set(seen)]
