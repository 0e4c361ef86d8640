"""The cells of the tables of `tables.py`: each runs a command of this project or a rival, once.

Finished cells are stored in OUT/cells as JSON and not computed again; stopped commands resume if they can. Failures and
missing programs are named in the table, and retried by the next call.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import head_path
from neural_strands.capture.hold_out import HOLD_OUT_EVERY, held_out_views, training_views
from neural_strands.capture.writer import CaptureWriter
from neural_strands.fitting.config import Preset
from neural_strands.foundation.files import write_json
from neural_strands.runs.evaluate import GRAIN

BENCHMARKS = Path(__file__).resolve().parents[1]
BROKEN = "failed: see {}"
NO_PROGRAM = "OpenSplat's program is not given (--opensplat)"


class MissingError(Exception):
    """A cell lacks something, which the message names for the table."""


@dataclass(frozen=True)
class Settings:
    """Settings shared by all cells of a folder; other settings need another folder.

    Attributes:
        preset: of our fits.
        steps: of our fits and ablations; None leaves the preset's to fits, and `ablations.py` its own.
        every: one view in so many is held out.
        rival_minutes: of a processor, for each rival; None gives it as many as our fit of the same views.
        grain: over the hair in our pictures that are scored, as `evaluate` draws it; they are scored without it, too.
    """

    preset: Preset
    steps: int | None
    every: int = HOLD_OUT_EVERY
    rival_minutes: float | None = None
    grain: float = GRAIN


@dataclass(frozen=True)
class Cells:
    """The cells of a folder.

    Attributes:
        out: the folder.
        settings: of all of them.
        opensplat: OpenSplat's program, if there is one.
        positions: weights of a prior that outputs positions, for the ablations; without them, one is trained.
    """

    out: Path
    settings: Settings
    opensplat: Path | None
    positions: Path | None = None

    def fit(self, capture: Path, seed: int) -> dict[str, Any]:
        """Our strands and their evaluation."""
        name = f"fit_{capture.name}_{seed}"

        def make() -> dict[str, Any]:
            run = self.out / "runs" / name
            made = self._run(name, ["-m", "neural_strands", "fit", str(capture), str(run), *self._fit_words(seed)])
            words = ["-m", "neural_strands", "evaluate", str(run), "--json"]
            scores = _renamed(self._run(f"evaluate_{capture.name}_{seed}", words))
            return {**scores, "strands": made["strands"], "steps": made["steps"], "minutes": self.minutes(name)}

        return self._cell(name, make)

    def rulers(self, capture: Path) -> dict[str, Any]:
        """Scores of blurred photographs, and of one half of the true strands against the other."""
        name = f"rulers_{capture.name}"
        script = str(BENCHMARKS / "quality" / "rulers.py")
        return self._cell(name, lambda: self._run(name, [script, "--captures", str(capture)]))

    def splats(self, capture: Path) -> dict[str, Any]:
        """OpenSplat on the views of our first fit."""
        name = f"splats_{capture.name}"
        count = len(Capture.load(capture))
        shown = training_views(count, self.settings.every)
        ours = self.fit(capture, 0)
        run = self.out / "runs" / f"fit_{capture.name}_0"
        return self._cell(name, lambda: self._splats(name, capture, shown, ours, run))

    def ablations(self, capture: Path, seed: int) -> dict[str, Any]:
        """All variants of `ablations.py`."""
        name = f"ablations_{capture.name}_{seed}"

        def make() -> dict[str, Any]:
            out = self.out / "ablations" / f"{capture.name}_{seed}"
            words = [str(BENCHMARKS / "quality" / "ablations.py"), str(capture), str(out), "--seed", str(seed)]
            words += ["--preset", self.settings.preset, "--positions-prior", str(self._positions_prior())]
            words += [] if self.settings.steps is None else ["--steps", str(self.settings.steps)]
            self._run(name, words)
            return {name: found[0] for name, found in json.loads((out / "table.json").read_text()).items()}

        return self._cell(name, make)

    def fewer(self, capture: Path, count: int) -> dict[str, Any]:
        """Our fit to some of the training views, scored on all held-out views."""
        name = f"fewer_{capture.name}_{count}"
        return self._cell(name, lambda: self._fewer(name, capture, self._shown(capture, count)))

    def fewer_splats(self, capture: Path, count: int) -> dict[str, Any]:
        """OpenSplat on the same views."""
        name = f"fewer_splats_{capture.name}_{count}"
        ours, shown = self.fewer(capture, count), self._shown(capture, count)
        run = self.out / "runs" / f"fewer_{capture.name}_{count}"
        return self._cell(name, lambda: self._splats(name, capture, shown, ours, run))

    def minutes(self, name: str) -> float:
        """Processor time of a command over all its calls, minutes."""
        path = self.out / "cells" / f"{name}.spent"
        return float(path.read_text()) / 60 if path.is_file() else 0.0

    def _positions_prior(self) -> Path:
        """Weights of a prior that outputs positions: those that are given, or those in OUT, trained once."""
        if self.positions is not None:
            return self.positions
        name, path = "positions_prior", self.out / "positions_prior.safetensors"
        words = ["-m", "neural_strands", "train-prior", str(path), "--seed", "0", "--json"]
        words += ["--config.generator.synthesiser.output", "position"]
        words += ["--resume"] if path.with_suffix(".checkpoint.pt").is_file() else []
        trained = self._cell(name, lambda: self._run(name, words))
        if "missing" in trained:
            raise MissingError(trained["missing"])
        return path

    def _shown(self, capture: Path, count: int) -> list[int]:
        opened = Capture.load(capture)
        return spread_views(opened, training_views(len(opened), self.settings.every), count)

    def _fit_words(self, seed: int) -> list[str]:
        words = ["--preset", self.settings.preset, "--seed", str(seed), "--resume", "--json"]
        return words if self.settings.steps is None else [*words, "--steps", str(self.settings.steps)]

    def _fewer(self, name: str, capture: Path, shown: list[int]) -> dict[str, Any]:
        opened = Capture.load(capture)
        part, run, drawn = (self.out / folder / name for folder in ("captures", "runs", "drawn"))
        if not (part / "transforms.json").is_file():
            write_part(opened, shown, part)
        words = ["-m", "neural_strands", "fit", str(part), str(run), *self._fit_words(0)]
        made = self._run(name, [*words, "--config.hold-out-every", "0"])
        held_out = [opened.cameras[index] for index in held_out_views(len(opened), self.settings.every)]
        CaptureWriter(drawn / "cameras").finish(held_out)
        found = {"strands": made["strands"], "steps": made["steps"], "minutes": self.minutes(name)}
        clean = {"hair": self._scored(f"{name}_clean", run, capture, drawn, grain=0.0)}
        found["views"] = {**self._scored(name, run, capture, drawn, self.settings.grain), "without_grain": clean}
        if opened.ground_truth is not None:
            words = ["score", str(run / "groom.npz"), str(capture), "--json"]
            found["geometry"] = self._run(f"truth_{name}", ["-m", "neural_strands", *words])
        return found

    def _scored(self, name: str, run: Path, capture: Path, drawn: Path, grain: float) -> dict[str, Any]:
        """Scores of a run's pictures over the hair, from the cameras in `drawn`."""
        cameras, views = str(drawn / "cameras" / "transforms.json"), str(drawn / name)
        words = ["render", str(run), "--camera", cameras, "--out", views, "--grain", str(grain), "--json"]
        self._run(f"render_{name}", ["-m", "neural_strands", *words])
        words = ["score-views", views, str(capture), "--every", str(self.settings.every), "--json"]
        return self._run(f"score_{name}", ["-m", "neural_strands", *words])["mean"]["hair"]

    def _splats(
        self, name: str, capture: Path, shown: Sequence[int], ours: dict[str, Any], run: Path
    ) -> dict[str, Any]:
        """OpenSplat on some views, for as long as our fit of them took, from the same segments."""
        if self.opensplat is None:
            raise MissingError(NO_PROGRAM)
        if "missing" in ours:
            raise MissingError(f"our fit of these views {ours['missing']}")
        words = [str(BENCHMARKS / "rivals" / "opensplat.py"), str(capture), str(self.out / "rivals" / name)]
        minutes = self.settings.rival_minutes or ours["minutes"]
        words += ["--program", str(self.opensplat), "--minutes", f"{minutes:.3f}"]
        words += ["--segments", str(run / "segments.npz"), "--every", str(self.settings.every)]
        found = self._run(name, [*words, "--training", *map(str, shown)])
        names = ("splats", "iterations", "processor_minutes")
        return {**{key: found[key] for key in names}, "views": found["scores"]["mean"]["hair"]}

    def _cell(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        path = self.out / "cells" / f"{name}.json"
        if not path.is_file():
            try:
                write_json(path, make())
            except MissingError as lack:
                return {"missing": str(lack)}
        return json.loads(path.read_text())

    def _run(self, name: str, words: Sequence[str]) -> dict[str, Any]:
        """Run a program of ours; returns the JSON object that it prints last, if any, and adds to its minutes."""
        log, spent = (self.out / "cells" / f"{name}.{suffix}" for suffix in ("log", "spent"))
        log.parent.mkdir(parents=True, exist_ok=True)
        print(f"{name} ...", file=sys.stderr, flush=True)
        before = os.times()
        with log.open("a") as log_file:
            done = subprocess.run(
                [sys.executable, *words], stdout=subprocess.PIPE, stderr=log_file, text=True, check=False
            )
        after = os.times()
        used = after.children_user + after.children_system - before.children_user - before.children_system
        spent.write_text(str(60 * self.minutes(name) + used))
        if done.returncode:
            raise MissingError(BROKEN.format(log))
        start = done.stdout.find("{")
        return json.loads(done.stdout[start:]) if start >= 0 else {}


def _renamed(evaluation: dict[str, Any]) -> dict[str, Any]:
    """What `evaluate` prints, under the names that cells of any origin share."""
    names = {"strands": "geometry", "lmvs": "segments", "held_out_views": "views"}
    return {names.get(key, key): value for key, value in evaluation.items()}


def spread_views(capture: Capture, among: Sequence[int], count: int) -> list[int]:
    """So many of the views, far from each other: each next is the farthest from those chosen before.

    Args:
        capture: all views.
        among: indices of those to choose from; the first is chosen first.
        count: how many; all of them where there are no more.
    """
    places = torch.stack([capture.cameras[index].position for index in among])
    chosen, distance = [0], torch.full((len(among),), torch.inf)
    while len(chosen) < min(count, len(among)):
        distance = torch.minimum(distance, (places - places[chosen[-1]]).norm(dim=1))
        chosen.append(int(distance.argmax()))
    return sorted(among[place] for place in chosen)


def write_part(capture: Capture, indices: Sequence[int], folder: Path) -> None:
    """Some views of a capture as a capture, with its head."""
    head = head_path(capture.folder)
    folder.mkdir(parents=True, exist_ok=True)
    for path in (head, capture.folder / "scalp_faces.json"):
        if path is not None and path.is_file():
            (folder / path.name).write_bytes(path.read_bytes())
    writer, views = CaptureWriter(folder), capture.views_on()
    cameras = []
    for index in indices:
        view = views[index]
        # Pictures are written without losses, whatever format they came in.
        camera = replace(view.camera, name=str(PurePosixPath(view.camera.name).with_suffix(".png")))
        writer.write_view(camera, view.image, view.hair_mask, view.person_mask)
        cameras.append(camera)
    writer.finish(cameras)
