"""`neural-strands demo`: the whole pipeline on a small synthetic capture."""

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from neural_strands.cli.commands.check import Check
from neural_strands.cli.commands.evaluate import Evaluate
from neural_strands.cli.commands.fit import Fit
from neural_strands.cli.commands.synthesize import Synthesize
from neural_strands.cli.streams import say
from neural_strands.foundation.configs import Between
from neural_strands.foundation.files import atomic_file


@dataclass(frozen=True)
class Demo:
    """Take a small capture of synthetic hair, reconstruct it, score it, and write pictures.

    The photographs of the default options ship with the package; for others, they are path-traced first. Writes
    OUT/capture (photographs with ground truth), OUT/run (groom.usd, groom.npz, model, report/index.html) and
    OUT/figures.json. A stopped demo continues when the same command is given again.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """Folder for the results."""
    style: Literal["short", "straight", "wavy", "curly"] = "straight"
    """Style of the true groom. Pictures of 256 pixels cannot show waves or curls; raise --resolution for those."""
    strands: Annotated[int, Between(100, 1_000_000)] = 10_000
    """Strands of the true groom."""
    views: Annotated[int, Between(4, 1000)] = 24
    """Photographs, every fifth of which is held out."""
    resolution: Annotated[int, Between(32, 8192)] = 256
    """Width and height of the photographs, pixels."""
    steps: Annotated[int, Between(1, 10_000_000)] | None = None
    """Optimisation steps, instead of those of the preset `demo`."""
    seed: Annotated[int, Between(0, 2**32 - 1)] = 0
    """Seed of all random numbers."""
    render: bool = False
    """Path-trace the photographs in any case, which takes some two minutes more."""

    def run(self) -> None:
        """Run every stage and report how long each took."""
        capture, run = self.out / "capture", self.out / "run"
        seconds: dict[str, float] = {}
        stages = {
            "synthesize": Synthesize(
                capture,
                style=self.style,
                strands=self.strands,
                views=self.views,
                resolution=self.resolution,
                seed=self.seed,
                shipped=not self.render,
            ),
            "check": Check(capture),
            "fit": Fit(capture, run, preset="demo", steps=self.steps, resume=True, seed=self.seed),
            "evaluate": Evaluate(run),
        }
        for name, stage in stages.items():
            began = time.perf_counter()
            say(f"demo: {name}")
            stage.run()
            seconds[name] = round(time.perf_counter() - began, 1)
        with atomic_file(self.out / "figures.json") as temporary:
            temporary.write_text(json.dumps({"seconds": seconds}, indent=2) + "\n", encoding="utf-8")
        told = ", ".join(f"{name} {value:g} s" for name, value in seconds.items())
        sys.stdout.write(f"{told}\nopen {run / 'report' / 'index.html'} and {run / 'groom.usd'}\n")
        sys.stdout.write(f"or look at it, cut it and export it in the browser: neural-strands view {run}\n")
