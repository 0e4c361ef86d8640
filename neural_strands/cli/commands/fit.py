"""`neural-strands fit`: photographs in, strands and their appearance out."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from neural_strands.cli.device import DeviceName, pick_device
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import Feedback, track


@dataclass(frozen=True)
class Fit:
    """Reconstruct the hair of a capture: strands rooted on the scalp, and an appearance that renders them.

    OUT/groom.usd opens in Blender as curves (metres, y up), OUT/groom.npz is the same for Python, OUT/model renders
    with `neural-strands render`. It can be stopped at any time: the results so far are usable, and --resume continues.
    """

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture: images, cameras, a head, and, if there are any, hair masks."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the run."""
    preset: Literal["demo", "fast", "paper"] = "fast"
    """demo: minutes on two cores; fast: within an hour on two cores; paper: full sizes, for one GPU."""
    head: Path | None = None
    """Head mesh in the cameras' frame, metres, instead of the capture's own; scalp_faces.json beside it is used."""
    segments: Path | None = None
    """Line segments of the training views (`neural-strands lmvs`), instead of computing them."""
    steps: int | None = None
    """Optimisation steps, instead of the preset's."""
    strands: int | None = None
    """Strands in the result, instead of the preset's."""
    minutes: float | None = None
    """Take as many steps as fit into this many minutes, instead of the preset's; measured at the start."""
    prior: Path | None = None
    """Weights of a strand prior (`neural-strands train-prior`), instead of those that ship with the package."""
    resume: bool = False
    """Continue the run in OUT."""
    seed: int = 0
    """Seed of everything random."""
    device: DeviceName = "auto"
    """Where to compute."""

    def run(self) -> None:
        """Fit, reporting progress on standard error."""
        from neural_strands.fitting.config import preset
        from neural_strands.runs.run_fit import FitRequest, run_fit

        for name in ("steps", "strands", "minutes"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"--{name}: expected more than 0, found {value:g}.")
        config = replace(preset(self.preset), seed=self.seed)
        config = replace(config, steps=self.steps or config.steps, strands=self.strands or config.strands)
        request = FitRequest(self.capture, self.out, self.head, self.segments, self.resume, self.minutes, self.prior)
        state = run_fit(request, config, pick_device(self.device), Feedback(say, track))
        sys.stdout.write(f"{len(state.drawn)} strands after {state.step} steps: {self.out / 'groom.usd'}\n")


def say(sentence: str) -> None:
    """Report one sentence on standard error."""
    sys.stderr.write(f"{sentence}\n")
    sys.stderr.flush()
