"""What all rivals that fit splats share: their options, what they are given, and how their splats are judged."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
import tyro
from scene import SeedPoints, over_surround, seed_points
from splats import SplatPicture, read_splats, render_splats

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, held_out_views, training_views
from neural_strands.fitting.config import preset
from neural_strands.fitting.stereo import check_source, find_segments, segments_source
from neural_strands.foundation.files import write_json
from neural_strands.foundation.progress import track
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.views import View
from neural_strands.lmvs.files import load_segments, load_segments_source, save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.scalp.head import Head

WHOLE = 30_000
"""Number of iterations for which the rivals' defaults are made."""


@dataclass(frozen=True, kw_only=True)
class SplatArguments:
    """Options of every such rival."""

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture, with a head and hair masks."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    segments: Path | None = None
    """Line segments of the training views (`neural-strands lmvs`), instead of computing them: the first points."""
    every: int = HOLD_OUT_EVERY
    """One view in so many is held out."""
    training: tuple[int, ...] | None = None
    """Show it only these of the training views, counted from 0 among all. Default: all that are not held out."""
    hair_points: int = 30_000
    """First points of the hair, at most."""
    head_points: int = 10_000
    """First points of the head."""
    seed: int = 0
    """Seed of the choice of points; the rival has its own seed."""


@dataclass(frozen=True)
class Spent:
    """Duration of a run: wall time and processor time, minutes; the latter is more meaningful on a busy machine."""

    minutes: float
    processor_minutes: float


def run_program(command: Sequence[str], log: Path, export: Path, folder: Path | None = None) -> Spent:
    """Run a program that exports splats.

    Args:
        command: its words.
        log: receives what it says.
        export: the file that it writes.
        folder: where it runs.
    """
    begin, before = time.perf_counter(), os.times()
    with log.open("w") as log_file:
        done = subprocess.run(command, stdout=log_file, stderr=subprocess.STDOUT, cwd=folder, check=False)
    after = os.times()
    if done.returncode or not export.is_file():
        raise SystemExit(
            f"{command[0]}: expected an export of splats, but it ended with status {done.returncode}; see {log}"
        )
    processor = after.children_user + after.children_system - before.children_user - before.children_system
    return Spent((time.perf_counter() - begin) / 60, processor / 60)


def shown_views(capture: Capture, arguments: SplatArguments) -> list[int]:
    """Indices of the views that the rival may see."""
    training = training_views(len(capture), arguments.every)
    chosen = training if arguments.training is None else sorted(set(arguments.training))
    if unknown := set(chosen) - set(training):
        raise SystemExit(f"--training: expected views that are not held out, found {min(unknown)}; leave it out.")
    return chosen


def first_segments(arguments: SplatArguments, capture: Capture, head: Head, chosen: list[int]) -> LineSegments:
    """Line segments of the views that are shown: those that are given, those of an earlier call, or new ones."""
    if arguments.segments is not None:
        check_source(arguments.segments, load_segments_source(arguments.segments), capture, arguments.every)
        return load_segments(arguments.segments)
    path = arguments.out / "segments.npz"
    if not path.is_file():
        seen, config = capture.subset(chosen), preset("fast")
        save_segments(
            path, find_segments(seen, head, config, arguments.out / "lmvs", track), segments_source(seen, config)
        )
    return load_segments(path)


def given(arguments: SplatArguments, capture: Capture, head: Head, chosen: list[int]) -> tuple[list[View], SeedPoints]:
    """The photographs that the rival may see, and the points that it starts from."""
    segments = first_segments(arguments, capture, head, chosen)
    views = capture.views_on()
    shown = [views[index] for index in chosen]
    counts, random = (arguments.hair_points, arguments.head_points), torch.Generator().manual_seed(arguments.seed)
    return shown, seed_points(segments, head.mesh, shown, counts, random)


def asked_of(arguments: SplatArguments, capture: Capture, chosen: list[int], **more: object) -> dict[str, Any]:
    """What a result is the answer to, in JSON; finished work counts only for the same question."""
    names = ("hair_points", "head_points", "seed")
    views = [capture.cameras[index].name for index in chosen]
    numbers = {name: getattr(arguments, name) for name in names}
    return {"capture": capture.folder.resolve().name, "views": views, **more, **numbers}


def print_result(
    arguments: SplatArguments,
    reconstruct: Callable[[Capture, Head, list[int]], dict[str, Any]],
    **asked: object,
) -> None:
    """Train unless that is done, draw, score, and print the result.

    Args:
        arguments: options of the rival.
        reconstruct: trains it on the capture, its head and the views that it may see, and writes the splats; returns
            its options, what it took, and `negative` if the photographs were.
        asked: further settings, with which finished work must agree.
    """
    capture = Capture.load(arguments.capture)
    head, chosen = find_head(capture, None), shown_views(capture, arguments)
    question, trained = asked_of(arguments, capture, chosen, **asked), arguments.out / "trained.json"
    if not trained.is_file():
        write_json(trained, {"asked": question, **reconstruct(capture, head, chosen)})
    kept = json.loads(trained.read_text())
    if kept["asked"] != question:
        raise SystemExit(f"{arguments.out}: was made with other settings; delete it, or choose another folder.")
    sys.stdout.write(json.dumps(judged(arguments, capture, head, kept.get("negative", False))) + "\n")


def judged(arguments: SplatArguments, capture: Capture, head: Head, negative: bool = False) -> dict[str, Any]:
    """Draw the held-out views before the surround of their photographs, score them, and keep the result."""
    out, finished = arguments.out, arguments.out / "result.json"
    if not finished.is_file():
        splats, views = read_splats(out / "splats.ply"), capture.views_on()
        for index in held_out_views(len(capture), arguments.every):
            name = Path(capture.cameras[index].name).with_suffix(".png").name
            if (out / "views" / name).is_file():
                continue
            view = views[index]
            picture = render_splats(splats, view.camera)
            if negative:
                picture = SplatPicture(picture.alpha[..., None] - picture.colour, picture.alpha)
            write_png(out / "views" / name, over_surround(picture.colour, picture.alpha, view, head.mesh))
        scores = _score(out / "views", arguments.capture, arguments.every)
        trained = json.loads((out / "trained.json").read_text())
        write_json(finished, {**trained, "splats": len(splats), "scores": scores})
    return json.loads(finished.read_text())


def _score(folder: Path, capture: Path, every: int) -> dict[str, Any]:
    """Scores by `neural-strands score-views`."""
    command = [sys.executable, "-m", "neural_strands", "score-views", str(folder), str(capture), "--json"]
    found = subprocess.run([*command, "--every", str(every)], capture_output=True, text=True, check=False)
    if found.returncode:
        raise SystemExit(found.stderr.strip())
    return json.loads(found.stdout)
