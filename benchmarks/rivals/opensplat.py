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
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
import tyro
from scene import write_scene
from splat_rival import WHOLE, Spent, SplatArguments, given, print_result, run_program

from neural_strands.capture.capture import Capture
from neural_strands.scalp.head import Head

PLAIN = (0.6130, 0.0101, 0.3984)
"""The colour over which OpenSplat blends splats, encoded."""
INTERVALS = {"resolution-schedule": 3000, "sh-degree-interval": 1000, "warmup-length": 500, "stop-screen-size-at": 4000}
"""Its defaults, in iterations."""
REFINE_EVERY = 100
"""Iterations between two rounds of splitting and culling."""
LEAST_ROUND = 50
"""Of those in a short run: gradients of fewer views are too noisy to split by."""
PILOT = 100
"""Number of iterations of the short run that measures the machine's speed."""


@dataclass(frozen=True, kw_only=True)
class Arguments(SplatArguments):
    """Options of the program."""

    program: Path | None = None
    """OpenSplat's program; without it, this rival is skipped."""
    iterations: int | None = None
    """How many."""
    minutes: float | None = None
    """Instead of a number: about as many as take this processor time, estimated by a run of 100, minutes."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where it computes; CUDA if it was built for it."""


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


def train(program: Path, scene: Path, splats: Path, log: Path, options: list[str], device: str = "cpu") -> Spent:
    """Run OpenSplat; the splats are written atomically."""
    unfinished = splats.with_name(f"unfinished_{splats.name}")
    place = ["--cpu"] if device == "cpu" else []
    command = [str(program), str(scene), *place, "--keep-crs", "-o", str(unfinished), *options]
    spent = run_program(command, log, unfinished)
    unfinished.replace(splats)
    return spent


def affordable(program: Path, out: Path, minutes: float, views: int, device: str = "cpu") -> int:
    """Estimate the number of iterations that take a given processor time, by a short run."""
    pilot = train(program, out / "scene", out / "pilot.ply", out / "pilot.log", settings(PILOT, views), device)
    return max(round(minutes / pilot.processor_minutes * PILOT), PILOT)


def reconstruct(arguments: Arguments, program: Path, capture: Capture, head: Head, chosen: list[int]) -> dict[str, Any]:
    """Write what OpenSplat reads and run it; returns its options and what it took."""
    out, device = arguments.out, arguments.device
    shown, seeds = given(arguments, capture, head, chosen)
    write_scene(out / "scene", shown, head.mesh, torch.tensor(PLAIN), seeds)
    iterations = arguments.iterations
    if iterations is None:
        iterations = affordable(program, out, arguments.minutes or 0.0, len(chosen), device)
    options = settings(iterations, len(chosen))
    spent = train(program, out / "scene", out / "splats.ply", out / "opensplat.log", options, device)
    return {"iterations": iterations, "options": options, **asdict(spent)}


def main(arguments: Arguments) -> None:
    """Train, draw, score."""
    program = arguments.program
    if program is None:
        print(json.dumps({"skipped": "OpenSplat: no program is given (--program)"}))
        return
    if (arguments.iterations is None) == (arguments.minutes is None):
        raise SystemExit("expected either --iterations or --minutes, found both or neither; give one.")
    if not os.access(program, os.X_OK):
        raise SystemExit(f"{program}: expected OpenSplat's program, found none; build it and name it.")
    asked = {"iterations": arguments.iterations, "minutes": arguments.minutes}
    print_result(arguments, partial(reconstruct, arguments, program), **asked)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
