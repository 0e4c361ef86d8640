"""3D Gaussian splats of a capture by gsplat's public trainer, on a GPU, scored like our own pictures.

    python benchmarks/rivals/gsplat_rival.py CAPTURE OUT --trainer GSPLAT/examples/simple_trainer.py

gsplat (github.com/nerfstudio-project/gsplat, Apache-2.0) is no part of this project: install it and what its examples
need for the Python that runs this, and name the trainer, which is called as a program with its default settings. It
sees what OpenSplat sees (see opensplat.py): the training views of `neural-strands fit` before a plain surround, and
points of the hair and of the head. The trainer blends splats over black, from which it could not tell dark hair. So it
gets the negatives of dark hair, and its pictures are turned back. It holds out every n-th photograph, the first one
included, and n is larger than their number: so the first photograph is there twice.

Skipped, with a line that says why, where gsplat or a GPU is missing or no trainer is given. Writes OUT/splats.ply,
OUT/views/, OUT/gsplat.log and OUT/result.json, and prints the last. What is finished in OUT is not done again.
"""

import importlib.util
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
import tyro
from colmap_scene import write_colmap
from scene import SeedPoints, write_scene
from splat_rival import WHOLE, SplatArguments, given, print_result, run_program

from neural_strands.capture.capture import Capture
from neural_strands.geometry.views import View
from neural_strands.scalp.head import Head

NEVER = 1_000_000
"""More than there are photographs or iterations."""
DARK = 0.5
"""Encoded brightness below which hair is dark."""


@dataclass(frozen=True, kw_only=True)
class Arguments(SplatArguments):
    """Options of the program."""

    trainer: Path | None = None
    """`examples/simple_trainer.py` of gsplat; without it, this rival is skipped."""
    iterations: int = WHOLE
    """How many; with fewer than 30,000, the trainer's intervals shrink in proportion (`--steps-scaler`)."""


def lacks(trainer: Path | None) -> str | None:
    """What is missing to run it, with its name; None if nothing is."""
    if importlib.util.find_spec("gsplat") is None:
        return f"gsplat: the package is not installed for {sys.executable}"
    if trainer is None:
        return "gsplat: no trainer is given (--trainer)"
    if not torch.cuda.is_available():
        return "gsplat: there is no GPU"
    return None


def trainer_words(trainer: Path, scene: Path, results: Path, iterations: int) -> list[str]:
    """The command that trains, and exports splats after the last iteration."""
    # Steps and intervals are multiplied and rounded down.
    scale = (iterations + 0.5) / WHOLE if iterations < WHOLE else 1.0
    options = {
        "data-dir": scene.resolve(),
        "data-factor": 1,
        "result-dir": results.resolve(),
        "test-every": NEVER,
        "steps-scaler": f"{scale:.9f}",
        "max-steps": max(iterations, WHOLE),
        "eval-steps": NEVER,
        "save-steps": NEVER,
    }
    words = [str(word) for name, value in options.items() for word in (f"--{name}", value)]
    flags = ["--save-ply", "--disable-viewer", "--disable-video", "--no-normalize-world-space"]
    return [sys.executable, str(trainer.resolve()), "default", *words, *flags]


def is_dark(views: Sequence[View]) -> bool:
    """Whether the hair of the photographs is dark."""
    weights = [torch.zeros_like(view.image[..., 0]) if view.hair_mask is None else view.hair_mask for view in views]
    total = sum(float(weight.sum()) for weight in weights)
    light = sum(float((weight * view.image.mean(dim=-1)).sum()) for weight, view in zip(weights, views, strict=True))
    return light < DARK * total


def write_input(folder: Path, views: Sequence[View], head: Head, seeds: SeedPoints) -> bool:
    """Write the scene, and return whether it is a negative."""
    negative = is_dark(views)
    first = min(views, key=lambda view: view.camera.name.replace("/", "_"))
    again = replace(first, camera=replace(first.camera, name=f"0_{first.camera.name}"))
    write_scene(folder, [again, *views], head.mesh, torch.full((3,), float(negative)), seeds, negative)
    colours = 1 - seeds.colours if negative else seeds.colours
    write_colmap(folder, Capture.load(folder).cameras, SeedPoints(seeds.points, colours))
    return negative


def reconstruct(arguments: Arguments, trainer: Path, capture: Capture, head: Head, chosen: list[int]) -> dict[str, Any]:
    """Write what the trainer reads and run it; returns its options and what it took."""
    out, results = arguments.out, arguments.out / "gsplat"
    shown, seeds = given(arguments, capture, head, chosen)
    negative = write_input(out / "scene", shown, head, seeds)
    shutil.rmtree(results, ignore_errors=True)
    words = trainer_words(trainer, out / "scene", results, arguments.iterations)
    export = results / "ply" / f"point_cloud_{arguments.iterations - 1}.ply"
    spent = run_program(words, out / "gsplat.log", export, trainer.parent)
    shutil.copyfile(export, out / "splats.ply")
    return {"iterations": arguments.iterations, "options": words[2:], "negative": negative, **asdict(spent)}


def main(arguments: Arguments) -> None:
    """Train, draw, score; or say what is missing."""
    trainer = arguments.trainer
    if (lack := lacks(trainer)) is not None or trainer is None:
        print(json.dumps({"skipped": lack}))
        return
    if not trainer.is_file():
        raise SystemExit(f"{trainer}: expected gsplat's trainer, found none; name its file.")
    print_result(arguments, partial(reconstruct, arguments, trainer), iterations=arguments.iterations)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
