"""3D Gaussian splats of a capture by OpenSplat, scored like our own pictures.

    python benchmarks/rivals/opensplat.py CAPTURE OUT --program PATH (--iterations N | --minutes M)

OpenSplat (github.com/pierotofy/OpenSplat, AGPL) is no part of this project: build it yourself, name the program, and it
is called as one. It sees the training views of `neural-strands fit` before a plain surround (see scene.py), and starts
from points of the hair and of the head. Its default settings are for 30,000 iterations; their intervals shrink in
proportion, and opacities are not reset, which a short run does not recover from. What it exports is drawn from the
held-out cameras by splats.py, because the program writes pictures of one view alone, and `neural-strands score-views`
scores them over the hair. Writes OUT/splats.ply, OUT/views/, OUT/opensplat.log and OUT/result.json, and prints the
last. What is finished in OUT is not done again.
"""

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import torch
import tyro
from scene import over_surround, seed_points, write_scene
from splats import read_splats, render_splats

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, held_out_views, training_views
from neural_strands.fitting.config import preset
from neural_strands.fitting.stereo import check_source, find_segments, segments_source
from neural_strands.foundation.files import write_json
from neural_strands.foundation.progress import track
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.files import load_segments, load_segments_source, save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.scalp.head import Head

PLAIN = (0.6130, 0.0101, 0.3984)
"""The colour over which OpenSplat blends splats, encoded."""
WHOLE = 30_000
"""Number of iterations for which its defaults are made."""
INTERVALS = {"resolution-schedule": 3000, "sh-degree-interval": 1000, "warmup-length": 500, "stop-screen-size-at": 4000}
"""Its defaults, in iterations."""
REFINE_EVERY = 100
"""Iterations between two rounds of splitting and culling."""
LEAST_ROUND = 50
"""Of those in a short run: gradients of fewer views are too noisy to split by."""
PILOT = 100
"""Number of iterations of the short run that measures the machine's speed."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture, with a head and hair masks."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the results."""
    program: Path
    """OpenSplat's program."""
    iterations: int | None = None
    """How many."""
    minutes: float | None = None
    """Instead of a number: about as many as take this processor time, estimated by a run of 100, minutes."""
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
    """Seed of the choice of points; OpenSplat has its own seed."""


def settings(iterations: int, views: int) -> list[str]:
    """OpenSplat's options: its defaults' intervals, shortened in proportion where there are fewer iterations."""
    share = min(iterations / WHOLE, 1.0)
    options = {name: max(round(share * length), 1) for name, length in INTERVALS.items()}
    options["refine-every"] = max(round(share * REFINE_EVERY), min(LEAST_ROUND, max(views, 1)), 10)
    if share < 1:
        # Longer than the run: no opacity is ever reset.
        options["reset-alpha-every"] = iterations
        options["warmup-length"] = max(options["warmup-length"], options["refine-every"])
    return [word for name, value in {"num-iters": iterations, **options}.items() for word in (f"--{name}", str(value))]


@dataclass(frozen=True)
class Spent:
    """Duration of a run: wall time and processor time, minutes; the latter is more meaningful on a busy machine."""

    minutes: float
    processor_minutes: float


def train(program: Path, scene: Path, splats: Path, log: Path, options: list[str]) -> Spent:
    """Run OpenSplat on the CPU; the splats are written atomically."""
    unfinished = splats.with_name(f"unfinished_{splats.name}")
    command = [str(program), str(scene), "--cpu", "--keep-crs", "-o", str(unfinished), *options]
    begin, before = time.perf_counter(), os.times()
    with log.open("w") as log_file:
        code = subprocess.run(command, stdout=log_file, stderr=subprocess.STDOUT, check=False).returncode
    after = os.times()
    if code or not unfinished.is_file():
        raise SystemExit(f"{program}: expected an export of splats, but it ended with status {code}; see {log}")
    unfinished.replace(splats)
    processor = after.children_user + after.children_system - before.children_user - before.children_system
    return Spent((time.perf_counter() - begin) / 60, processor / 60)


def affordable(program: Path, out: Path, minutes: float, views: int) -> int:
    """Estimate the number of iterations that take a given processor time, by a short run."""
    pilot = train(program, out / "scene", out / "pilot.ply", out / "pilot.log", settings(PILOT, views))
    return max(round(minutes / pilot.processor_minutes * PILOT), PILOT)


def first_segments(arguments: Arguments, capture: Capture, head: Head, chosen: list[int]) -> LineSegments:
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


def draw(splats: Path, capture: Capture, head: Head, shown: list[int], folder: Path) -> None:
    """Draw the held-out views, before the surround of their photographs."""
    scene, views = read_splats(splats), capture.views_on()
    for index in shown:
        view = views[index]
        picture = render_splats(scene, view.camera)
        path = folder / Path(view.camera.name).with_suffix(".png").name
        write_png(path, over_surround(picture.colour, picture.alpha, view, head.mesh))


def score(folder: Path, capture: Path, every: int) -> dict[str, Any]:
    """Scores by `neural-strands score-views`."""
    command = [sys.executable, "-m", "neural_strands", "score-views", str(folder), str(capture), "--json"]
    found = subprocess.run([*command, "--every", str(every)], capture_output=True, text=True, check=False)
    if found.returncode:
        raise SystemExit(found.stderr.strip())
    return json.loads(found.stdout)


def reconstruct(arguments: Arguments, capture: Capture, head: Head, chosen: list[int]) -> dict[str, Any]:
    """Write what OpenSplat reads and run it; returns its options and what it took."""
    out = arguments.out
    segments = first_segments(arguments, capture, head, chosen)
    views = capture.views_on()
    shown = [views[index] for index in chosen]
    counts, random = (arguments.hair_points, arguments.head_points), torch.Generator().manual_seed(arguments.seed)
    seeds = seed_points(segments, head.mesh, shown, counts, random)
    write_scene(out / "scene", shown, head.mesh, torch.tensor(PLAIN), seeds)
    iterations = arguments.iterations
    if iterations is None:
        iterations = affordable(arguments.program, out, arguments.minutes or 0.0, len(chosen))
    options = settings(iterations, len(chosen))
    spent = train(arguments.program, out / "scene", out / "splats.ply", out / "opensplat.log", options)
    return {"iterations": iterations, "options": options, **asdict(spent)}


def shown_views(capture: Capture, arguments: Arguments) -> list[int]:
    """Indices of the views that OpenSplat may see."""
    training = training_views(len(capture), arguments.every)
    chosen = training if arguments.training is None else sorted(set(arguments.training))
    if unknown := set(chosen) - set(training):
        raise SystemExit(f"--training: expected views that are not held out, found {min(unknown)}; leave it out.")
    return chosen


def main(arguments: Arguments) -> None:
    """Train, draw, score."""
    if (arguments.iterations is None) == (arguments.minutes is None):
        raise SystemExit("expected either --iterations or --minutes, found both or neither; give one.")
    if not os.access(arguments.program, os.X_OK):
        raise SystemExit(f"{arguments.program}: expected OpenSplat's program, found none; build it and name it.")
    capture, out = Capture.load(arguments.capture), arguments.out
    head = find_head(capture, None)
    chosen = shown_views(capture, arguments)
    asked = {
        "capture": capture.folder.resolve().name,
        "views": [capture.cameras[index].name for index in chosen],
        **{name: getattr(arguments, name) for name in ("iterations", "minutes", "hair_points", "head_points", "seed")},
    }
    trained, finished = out / "trained.json", out / "result.json"
    if not trained.is_file():
        write_json(trained, {"asked": asked, **reconstruct(arguments, capture, head, chosen)})
    elif json.loads(trained.read_text())["asked"] != asked:
        raise SystemExit(f"{out}: was made with other settings; delete it, or choose another folder.")
    if not finished.is_file():
        draw(out / "splats.ply", capture, head, held_out_views(len(capture), arguments.every), out / "views")
        splats, scores = len(read_splats(out / "splats.ply")), score(out / "views", arguments.capture, arguments.every)
        write_json(finished, {**json.loads(trained.read_text()), "splats": splats, "scores": scores})
    print(json.dumps(json.loads(finished.read_text())))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
