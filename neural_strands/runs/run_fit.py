"""One fit from start to end: segments, first strands, steps, checkpoints, results."""

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.hold_out import training_views
from neural_strands.evaluation.lpips import find_lpips
from neural_strands.evaluation.structural_loss import structural_loss
from neural_strands.fitting.checkpoint import load_checkpoint, save_checkpoint
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.distributed import Workers
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import FitState, fit
from neural_strands.fitting.fit_data import FitData, check_inputs, check_views, gather_fit_data
from neural_strands.fitting.losses import Perceptual
from neural_strands.fitting.stereo import find_segments
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.files import load_segments, save_segments
from neural_strands.prior.vae import StrandPrior, load_prior
from neural_strands.runs.forecast import forecast, steps_for
from neural_strands.runs.outputs import write_outputs, write_preview
from neural_strands.runs.run_folder import (
    RunDescription,
    RunFolder,
    check_same,
    fingerprint,
    read_description,
    weights_digest,
    write_description,
)
from neural_strands.scalp.head import Head
from neural_strands.scalp.load import load_head

CHECKPOINT_SECONDS = 60.0
PREVIEW_SECONDS = 120.0


@dataclass(frozen=True)
class FitRequest:
    """What to fit and where to put it.

    Attributes:
        capture: folder of the capture.
        out: folder of the run.
        head: head file that replaces the capture's, if any.
        segments: line segments of the training views, if they are already there.
        resume: go on with the run in `out`.
        minutes: take as many steps as fit into this many minutes, if set.
        prior: weights of a strand prior, instead of those that come with the package.
    """

    capture: Path
    out: Path
    head: Path | None = None
    segments: Path | None = None
    resume: bool = False
    minutes: float | None = None
    prior: Path | None = None


class RunLog:
    """Figures of every step, one JSON object a line; lines past the step that a run resumes from are dropped."""

    def __init__(self, path: Path, step: int) -> None:
        """Open for a run that has done `step` steps.

        Raises:
            InputError: the file cannot be written.
        """
        self._path = path
        kept = path.read_text(encoding="utf-8").splitlines()[:step] if path.is_file() and step else []
        with atomic_file(path) as temporary:
            temporary.write_text("".join(line + "\n" for line in kept), encoding="utf-8")
        self._waiting: list[str] = []

    def add(self, figures: dict[str, float]) -> None:
        """Append one step; `flush` puts it on disk."""
        self._waiting.append(json.dumps({name: round(value, 6) for name, value in figures.items()}) + "\n")

    def flush(self) -> None:
        """Put what was added on disk.

        Raises:
            InputError: the disk is full or cannot be written to.
        """
        lines, self._waiting = self._waiting, []
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.writelines(lines)
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written ({error.strerror or error}).") from error


def run_fit(
    request: FitRequest,
    config: FitConfig,
    device: torch.device,
    say: Callable[[str], None],
    track: Callable[[Iterable, str, int], Iterable],
) -> FitState:
    """Fit a capture into a folder.

    Args:
        request: what and where.
        config: settings; those of a resumed run must be the same.
        device: where to compute.
        say: told one sentence at each stage.
        track: shows progress of a loop, given the items, a description and their number.

    Raises:
        InputError: anything about the input that no fit can come of; what was there before stays.
    """
    workers = Workers.join(device)
    folder = RunFolder(request.out)
    capture = Capture.load(request.capture)
    head = find_head(capture, request.head)
    going_on = folder.description.is_file()
    if going_on and not request.resume:
        raise InputError(f"{request.out}: a run is there already; give --resume to go on with it, or another folder.")
    # Before anything is written: what is refused here leaves no run behind.
    seen = capture.subset(training_views(len(capture), config.hold_out_every))
    check_views(seen)
    if request.segments is not None and not folder.segments.is_file():
        check_inputs(seen, load_segments(request.segments), head)
    prior, perceptual = fit_prior(request.prior, device), perceptual_loss(device, say)
    if not going_on:
        cost = forecast(capture, head, prior, config, perceptual, device, with_stereo=request.segments is None)
        if request.minutes is not None:
            config = replace(config, steps=steps_for(request.minutes, cost, config))
            cost = replace(cost, fit_seconds=60 * request.minutes)
        say(cost.sentence())
    elif request.minutes is not None:
        config = replace(config, steps=read_description(folder).config.steps)
    described = RunDescription(
        str(request.capture), str(request.head or ""), fingerprint(capture, head), config, weights_digest(prior)
    )
    if going_on:
        check_same(folder, described)
    if workers.leads:
        write_description(folder, described)
        if not folder.segments.is_file():
            found = load_segments(request.segments) if request.segments is not None else None
            save_segments(folder.segments, found or _stereo(folder, capture, head, config, device, say, track))
    workers.wait()
    segments = load_segments(folder.segments)
    data = gather_fit_data(capture, head, segments, config, device)
    say(f"{len(segments)} segment points" + ("; tracing first strands" if config.initialise == "flow" else ""))
    state = begin(data, prior, config)
    if going_on and folder.checkpoint.is_file():
        load_checkpoint(state, folder.checkpoint)
        say(f"going on from step {state.step} of {config.steps}")
    try:
        _steps(state, data, config, perceptual, folder, workers, track)
    finally:
        if workers.leads:
            save_checkpoint(state, folder.checkpoint)
            write_outputs(folder, state.model, data, {"capture": str(request.capture), "step": str(state.step)})
        workers.close()
    return state


def find_head(capture: Capture, given: Path | None) -> Head:
    """The head that was given, or the capture's own with its scalp faces.

    Raises:
        InputError: there is none, or it cannot be read.
    """
    if given is not None:
        return load_head(given)
    if capture.head_path is None:
        raise InputError(
            f"{capture.folder}: expected head.obj (the head in the cameras' frame, metres), found none; "
            "put one there or name it with --head."
        )
    faces = capture.folder / "scalp_faces.json"
    return load_head(capture.head_path, faces if faces.is_file() else None, scale=1.0)


def fit_prior(path: Path | None, device: torch.device) -> StrandPrior:
    """The prior as a fit uses it: those weights, or the package's own; without its coupling layers, if it has any.

    Raises:
        InputError: no such file, or no strand prior in it.
    """
    prior = load_prior(path, device)
    return prior.without_modulator() if prior.generator.config.modulator == "coupling" else prior


def perceptual_loss(device: torch.device, say: Callable[[str], None]) -> Perceptual:
    """LPIPS where its weights can be had, the structural loss otherwise."""
    metric, reason = find_lpips("squeeze", device)
    if metric is not None:
        return metric
    say(f"{reason}; training uses the structural loss instead")
    return structural_loss


def _stereo(
    folder: RunFolder,
    capture: Capture,
    head: Head,
    config: FitConfig,
    device: torch.device,
    say: Callable[[str], None],
    track: Callable[[Iterable, str, int], Iterable],
) -> LineSegments:
    """Segments of the training views; what is finished of them is kept in the run's folder."""
    say("line-based multi-view stereo over the training views")
    seen = capture.subset(training_views(len(capture), config.hold_out_every))
    return find_segments(seen, head, config.seed, folder.path / "lmvs", track, device)


def _steps(
    state: FitState,
    data: FitData,
    config: FitConfig,
    perceptual: Perceptual,
    folder: RunFolder,
    workers: Workers,
    track: Callable[[Iterable, str, int], Iterable],
) -> None:
    """The loop with everything that happens now and then around it."""
    log = RunLog(folder.log, state.step) if workers.leads else None
    saved = shown = time.monotonic()
    bar = iter(track(range(state.step, config.steps), "fitting", config.steps - state.step))

    def after_step(now: FitState, figures: dict[str, float]) -> None:
        nonlocal saved, shown
        next(bar, None)
        if log is None:
            return
        log.add(figures)
        clock = time.monotonic()
        if clock - saved > CHECKPOINT_SECONDS:
            log.flush()
            save_checkpoint(now, folder.checkpoint)
            saved = clock
        if clock - shown > PREVIEW_SECONDS:
            write_preview(folder.preview, now.model, now.drawn, data)
            shown = clock

    try:
        fit(state, data, config, perceptual, workers, after_step)
    finally:
        if log is not None:
            log.flush()
