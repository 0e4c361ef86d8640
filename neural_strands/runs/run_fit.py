"""One fit from start to end: prepare a new run or one to resume, gather its inputs, take its steps."""

import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import training_views
from neural_strands.capture.mask_agreement import with_judged_masks
from neural_strands.fitting.checkpoint import load_checkpoint, save_checkpoint
from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.distributed import Workers
from neural_strands.fitting.first_model import begin, fit_prior
from neural_strands.fitting.fit import FitState, fit
from neural_strands.fitting.fit_data import FitData, check_inputs, check_views, gather_fit_data, head_distance_grid
from neural_strands.fitting.losses import Perceptual
from neural_strands.fitting.perceptual import perceptual_loss
from neural_strands.fitting.stereo import check_source, find_segments, segments_source
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import check_folder_writable, sole_writer
from neural_strands.foundation.progress import Feedback, Steps
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.lmvs.files import load_segments, load_segments_source, save_segments
from neural_strands.model.networks import Networks, read_networks
from neural_strands.prior.vae import StrandPrior
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
from neural_strands.runs.run_log import RunLog
from neural_strands.scalp.head import Head

CACHE_BYTES_FOR_A_GPU = 4 * 2**30
"""Size of the cache of decoded photographs for a fit on a GPU, whose steps are faster than decoding: 4 GiB, enough for
200 photographs of 4 megapixels and their masks."""
FORECAST_FROM = 100
"""Smallest number of steps of a fit that is forecast: the forecast's trial steps would take much of a shorter one."""
CHECKPOINT_SECONDS = 60.0
PREVIEW_SECONDS = 120.0


@dataclass(frozen=True)
class FitRequest:
    """What to fit, and where to write it.

    Attributes:
        capture: folder of the capture.
        out: folder of the run.
        head: head file that replaces the capture's, if any.
        segments: line segments of the training views, if they exist already.
        resume: continue the run in `out`.
        minutes: take as many steps as fit into this many minutes, if set.
        prior: weights of a strand prior, instead of those that come with the package.
        networks: weights from which the networks start, instead of those that come with the package.
    """

    capture: Path
    out: Path
    head: Path | None = None
    segments: Path | None = None
    resume: bool = False
    minutes: float | None = None
    prior: Path | None = None
    networks: Path | None = None


@dataclass(frozen=True)
class PreparedRun:
    """A run whose request has been checked, before anything is written.

    Attributes:
        folder: the run's folder.
        described: contents of `run.json`, settings included.
        capture: all views.
        head: mesh and scalp chart.
        distance: signed distance to the head; None for a run to resume, which samples it only once.
        prior: strand prior.
        networks: given weights from which the networks start, if any.
        perceptual: perceptual distance.
        resuming: whether the folder already contains this run.
        device: where to compute.
        workers: the processes that share the fit.
    """

    folder: RunFolder
    described: RunDescription
    capture: Capture
    head: Head
    distance: SignedDistanceGrid | None
    prior: StrandPrior
    networks: Networks | None
    perceptual: Perceptual
    resuming: bool
    device: torch.device
    workers: Workers

    @property
    def config(self) -> FitConfig:
        """The resolved settings."""
        return self.described.config

    @property
    def training_capture(self) -> Capture:
        """The views that the fit may use."""
        return self.capture.subset(training_views(len(self.capture), self.config.hold_out_every))


def run_fit(request: FitRequest, config: FitConfig, device: torch.device, feedback: Feedback) -> FitState:
    """Fit a capture into a folder.

    Args:
        request: what to fit, and where.
        config: settings; those of a resumed run must be the same.
        device: where to compute.
        feedback: receives each stage and the progress within it.

    Raises:
        InputError: the input makes a fit impossible; existing files stay unchanged.
    """
    workers = Workers.join(device)
    try:
        run = prepare_run(request, config, device, workers, feedback)
        with sole_writer(request.out) if workers.leads else nullcontext():
            check_begun(run)
            data = gather_inputs(run, request.segments, feedback)
            return run_steps(run, data, feedback)
    finally:
        workers.close()


def prepare_run(
    request: FitRequest, config: FitConfig, device: torch.device, workers: Workers, feedback: Feedback
) -> PreparedRun:
    """Check a new run or the one to resume, and report its expected cost; nothing is written.

    The cost of a short fit, or of one that nobody follows, is not forecast: trials would take time for nothing.

    Raises:
        InputError: the capture, the head or the segments cannot be fitted, the prior or the networks cannot be used, or
            the folder contains another run or cannot be written to.
    """
    folder = RunFolder(request.out)
    if request.out.resolve() == request.capture.resolve():
        raise InputError(f"{request.out}: expected another folder than the capture's, found the same; name a new one.")
    large = () if device.type == "cpu" else (CACHE_BYTES_FOR_A_GPU,)
    capture = Capture.load(request.capture, *large)
    head = find_head(capture, request.head)
    resuming = folder.description.is_file()
    # No process may create the folder before all processes have checked it.
    workers.wait()
    if resuming and not request.resume:
        raise _run_there(request.out)
    if workers.leads:
        check_folder_writable(request.out)
    training = training_views(len(capture), config.hold_out_every)
    check_views(capture.subset(training))
    if config.correct_masks:
        capture = with_judged_masks(capture, training, head.mesh, feedback.say)
    given = None
    if request.segments is not None and not resuming:
        given = load_segments(request.segments)
        check_inputs(capture.subset(training), given, head)
        source = load_segments_source(request.segments)
        if warning := check_source(request.segments, source, capture, config.hold_out_every):
            feedback.say(warning)
    networks = None if request.networks is None else read_networks(request.networks, config.model)
    prior, perceptual = fit_prior(request.prior, device), perceptual_loss(device, feedback.say)
    distance = None if resuming else head_distance_grid(head.mesh.to(device))
    forecast_helps = feedback.heard and config.steps >= FORECAST_FROM
    if distance is not None and (request.minutes is not None or forecast_helps):
        cost = forecast(capture, head, prior, config, perceptual, device, given, distance)
        if request.minutes is not None:
            config = replace(config, steps=workers.agree(steps_for(request.minutes, cost, config)))
            cost = replace(cost, fit_seconds=60 * request.minutes)
        feedback.say(cost.sentence())
    elif resuming and request.minutes is not None:
        config = replace(config, steps=read_description(folder).config.steps)
    described = RunDescription(
        str(request.capture.absolute()),
        "" if request.head is None else str(request.head.absolute()),
        fingerprint(capture, head),
        config,
        weights_digest(prior),
        str(request.out.absolute()),
    )
    if resuming:
        check_same(folder, described)
    return PreparedRun(
        folder, described, capture, head, distance, prior, networks, perceptual, resuming, device, workers
    )


def check_begun(run: PreparedRun) -> None:
    """Refuse a new run if another process has started one in the folder since this one was prepared.

    Raises:
        InputError: the folder contains a run by now.
    """
    if run.folder.description.is_file() and not run.resuming:
        raise _run_there(run.folder.path)


def gather_inputs(run: PreparedRun, given: Path | None, feedback: Feedback) -> FitData:
    """Load or compute the line segments of the training views, store them in the run, and gather all inputs.

    Args:
        run: result of `prepare_run`.
        given: file of segments to start a new run from; without one, line-based multi-view stereo computes them.
            Finished views are stored in the run's folder, so that a stopped run continues.
        feedback: receives stages and progress.

    Raises:
        InputError: too few segments, or segments far from the head; no run is started.
    """
    kept = run.folder.segments
    if run.workers.leads and not (run.resuming and kept.is_file()):
        if given is not None:
            segments, source = load_segments(given), load_segments_source(given)
        else:
            feedback.say("line-based multi-view stereo over the training views")
            work = run.folder.path / "lmvs"
            segments = find_segments(run.training_capture, run.head, run.config, work, feedback.track, run.device)
            check_inputs(run.training_capture, segments, run.head)
            source = segments_source(run.training_capture, run.config)
        save_segments(kept, segments, source)
    run.workers.wait()
    return gather_fit_data(run.capture, run.head, load_segments(kept), run.config, run.device, run.distance)


def run_steps(run: PreparedRun, data: FitData, feedback: Feedback) -> FitState:
    """Start from initial strands or the checkpoint, take the remaining steps, and write the results.

    If it is stopped at any point, the run has a checkpoint and usable results.

    Raises:
        InputError: the checkpoint is damaged, the fit diverges, or the disk is full.
    """
    folder, config, leads = run.folder, run.config, run.workers.leads
    resuming = run.resuming and folder.checkpoint.is_file()
    # All processes must have looked for a checkpoint before one writes it.
    run.workers.wait()
    tracing = config.initialise == "flow" and not resuming
    feedback.say(f"{len(data.segments)} segment points{'; tracing first strands' if tracing else ''}")
    # The checkpoint has everything except the roots, which are drawn again from the seed.
    if resuming:
        state = begin(data, run.prior, replace(config, initialise="mean", networks="random"), feedback)
    else:
        state = begin(data, run.prior, config, feedback, run.networks)
    if resuming:
        load_checkpoint(state, folder.checkpoint)
        feedback.say(f"resuming at step {state.step} of {config.steps}")
    elif leads:
        # Save at once: tracing the initial strands takes as long as hundreds of steps.
        save_checkpoint(state, folder.checkpoint)
    run.workers.wait()
    if leads:
        write_description(folder, run.described)
    try:
        _steps(state, run, data, feedback)
    finally:
        if leads:
            save_checkpoint(state, folder.checkpoint)
            write_outputs(folder, state.model, data, {"capture": str(run.capture.folder), "step": str(state.step)})
    return state


def steps_per_reading(device: torch.device) -> int:
    """Number of steps after which the device is asked for their figures; while a GPU answers, it gets no new work."""
    return 1 if device.type == "cpu" else 10


def _steps(state: FitState, run: PreparedRun, data: FitData, feedback: Feedback) -> None:
    """The loop, with the log, checkpoints and previews around it."""
    folder, config = run.folder, run.config
    log = RunLog(folder.log, state.step) if run.workers.leads else None
    saved = shown = time.monotonic()
    steps = Steps(feedback.track, "fitting", config.steps - state.step)

    def after_step(now: FitState, figures: dict[str, float]) -> None:
        nonlocal saved, shown
        steps.done()
        if log is None:
            return
        log.add(figures)
        if figures["step"] < now.step:
            # The log must have the figures of all steps of a checkpoint.
            return
        clock = time.monotonic()
        if clock - saved > CHECKPOINT_SECONDS:
            log.flush()
            save_checkpoint(now, folder.checkpoint)
            saved = clock
        if clock - shown > PREVIEW_SECONDS:
            write_preview(folder.preview, now.model, now.drawn, data)
            shown = clock

    try:
        fit(state, data, config, run.perceptual, run.workers, after_step, steps_per_reading(run.device))
    finally:
        if log is not None:
            log.flush()


def _run_there(folder: Path) -> InputError:
    return InputError(f"{folder}: a run is there already; give --resume to continue it, or name another folder.")
