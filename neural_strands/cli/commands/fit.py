"""`neural-strands fit`: photographs in, strands and their appearance out."""

import sys
import time
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from neural_strands.cli.device import DeviceName, leads, pick_device
from neural_strands.cli.settings import parse_with_settings
from neural_strands.cli.streams import print_json, say
from neural_strands.foundation.configs import Between
from neural_strands.foundation.progress import Feedback, track

if TYPE_CHECKING:
    from neural_strands.fitting.config import FitConfig


@dataclass(frozen=True)
class Fit:
    """Reconstruct the hair of a capture: strands rooted on the scalp, and an appearance that renders them.

    OUT/groom.usd opens in Blender as curves (metres, y up), OUT/groom.npz is the same for Python, OUT/model renders
    with `neural-strands render`. It can be stopped at any time: the results so far are usable, and --resume continues.
    Several GPUs: torchrun --standalone --nproc-per-node 4 -m neural_strands fit ...
    """

    capture: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture: images, cameras, a head and, optionally, hair masks."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder for the run."""
    preset: Literal["demo", "fast", "paper"] = "fast"
    """demo: minutes on two cores; fast: within half an hour on two cores; paper: full sizes, for one GPU."""
    head: Path | None = None
    """Head mesh in the cameras' frame, metres, instead of the capture's own; scalp_faces.json beside it is used."""
    segments: Path | None = None
    """Line segments of the training views (`neural-strands lmvs`), instead of computing them."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """JSON or TOML file of settings that replace those of the preset; the run.json of another run works too. Change a
    single setting with --config.NAME VALUE, such as --config.weights.alpha 0.3."""
    help_config: bool = False
    """List every setting that --config.NAME takes."""
    settings: tyro.conf.Suppress[Any] = None
    """The settings of the fit; the defaults shown are those of the preset and the file."""
    steps: Annotated[int, Between(1, 10_000_000)] | None = None
    """Number of optimisation steps, overriding preset and file."""
    strands: Annotated[int, Between(1, 1_000_000)] | None = None
    """Number of strands in the result, overriding preset and file."""
    minutes: Annotated[float, Between(0.01, 1_000_000)] | None = None
    """Take as many steps as fit into this many minutes, instead of a fixed number; their speed is measured first."""
    prior: Path | None = None
    """Weights of a strand prior (`neural-strands train-prior`), instead of those that ship with the package."""
    networks: Path | None = None
    """Weights from which the networks start (`neural-strands train-networks`, or OUT/model/model.safetensors of
    another run), instead of those that ship with the package."""
    resume: bool = False
    """Continue the run in OUT."""
    seed: Annotated[int, Between(0, 2**32 - 1)] | None = None
    """Seed of all random numbers, overriding preset and file."""
    device: DeviceName = "auto"
    """Where to compute."""
    view: bool = False
    """Show the fit on a page in the browser while it runs (needs the extra `view`)."""
    json: bool = False
    """Print JSON instead of text: strands, steps, seconds, the losses of the last step, and files."""

    @classmethod
    def parse(cls, prog: str, words: Sequence[str]) -> "Fit | None":
        """Parse the words of the command line; None if they ask for help."""
        return parse_with_settings(cls, prog, words, _settings)

    def run(self) -> None:
        """Fit, reporting progress on standard error."""
        from neural_strands.fitting.config import check_fit_config
        from neural_strands.runs.run_fit import FitRequest, run_fit
        from neural_strands.runs.run_folder import RunFolder
        from neural_strands.runs.run_log import read_log
        from neural_strands.viewer.beside import page_beside

        began = time.perf_counter()
        config = self.settings or _settings(self.preset, self.config)
        given = {name: getattr(self, name) for name in ("steps", "strands", "seed") if getattr(self, name) is not None}
        config = replace(config, **given)
        check_fit_config(config, "--config")
        request = FitRequest(
            self.capture, self.out, self.head, self.segments, self.resume, self.minutes, self.prior, self.networks
        )
        feedback = Feedback(say, track) if leads() else Feedback()
        with page_beside(self.out) if self.view and leads() else nullcontext():
            state = run_fit(request, config, pick_device(self.device), feedback)
        if not leads():
            return
        folder = RunFolder(self.out)
        if not self.json:
            sys.stdout.write(f"{len(state.drawn)} strands after {state.step} steps: {folder.groom}\n")
            return
        names = ("groom", "groom_arrays", "model", "log", "description")
        figures = {
            "strands": len(state.drawn),
            "steps": state.step,
            "seconds": round(time.perf_counter() - began, 1),
            "last_step": (read_log(folder.log) or [{}])[-1],
            "files": {name: str(getattr(folder, name)) for name in names},
        }
        print_json(figures, indent=2)


def _settings(name: str, file: Path | None) -> "FitConfig":
    """The settings of a preset, replaced by those of a file where one is given."""
    from neural_strands.fitting import config

    base = config.preset(name)
    return base if file is None else config.read_fit_config(file, base)
