"""A fit as a run: a refused fit leaves nothing that blocks the next one."""

import itertools
import re
import shutil
import time
from contextlib import nullcontext
from dataclasses import replace

import pytest
import torch
from counted_loops import CountedLoops
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.fitting import first_model
from neural_strands.fitting import fit as fit_module
from neural_strands.fitting.distributed import Workers
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import sole_writer
from neural_strands.foundation.progress import Feedback
from neural_strands.lmvs.files import save_segments
from neural_strands.runs import forecast as forecast_module
from neural_strands.runs import run_fit as run_fit_module
from neural_strands.runs.forecast import Forecast
from neural_strands.runs.run_fit import FitRequest, prepare_run, run_fit
from neural_strands.runs.run_folder import RunFolder
from neural_strands.runs.run_log import read_log

pytestmark = pytest.mark.usefixtures("shapes_unchecked")
CPU = torch.device("cpu")


SHORT = tiny_config(steps=6, initialise="mean")


def requests_in(folder):
    """Asks for a fit of a small capture in the folder into a folder of this name."""
    save_segments(folder / "segments.npz", true_segments(write_capture(folder / "ball", views=4)))

    def made(name, **changes):
        request = FitRequest(folder / "ball", folder / name, segments=folder / "segments.npz")
        return replace(request, **changes)

    return made


@pytest.fixture
def request_of(tmp_path, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    return requests_in(tmp_path)


def bits(request) -> dict[str, bytes]:
    names = ("model/model.safetensors", "groom.npz", "groom.usd")
    return {name: (request.out / name).read_bytes() for name in names}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """What a short fit writes that nothing disturbs."""
    folder = tmp_path_factory.mktemp("undisturbed")
    request = requests_in(folder)("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEURAL_STRANDS_WEIGHTS", str(folder / "none"))
        run_fit(request, SHORT, CPU, Feedback())
    return bits(request)


def test_a_second_fit_in_the_same_folder_is_refused(request_of):
    config = tiny_config(steps=2, initialise="mean")
    with sole_writer(request_of("run").out):
        with pytest.raises(InputError, match="expected a folder that no other process writes to"):
            run_fit(request_of("run"), config, CPU, Feedback())
        assert [path.name for path in request_of("run").out.iterdir()] == [".in_use"]
    run_fit(request_of("run"), config, CPU, Feedback())
    assert not [path for path in request_of("run").out.iterdir() if path.name.startswith(".")]


def test_a_fit_that_another_has_begun_meanwhile_is_refused(request_of, monkeypatch):
    config, prepare = tiny_config(steps=2, initialise="mean"), run_fit_module.prepare_run

    def slowly(*arguments):
        prepared = prepare(*arguments)
        with monkeypatch.context() as patch:
            patch.setattr(run_fit_module, "prepare_run", prepare)
            run_fit(request_of("run"), config, CPU, Feedback())
        return prepared

    monkeypatch.setattr(run_fit_module, "prepare_run", slowly)
    with pytest.raises(InputError, match="a run is there already"):
        run_fit(request_of("run"), config, CPU, Feedback())


@pytest.mark.parametrize("harm", ["vanishes", "changes"])
def test_a_capture_that_is_harmed_under_a_fit_costs_nothing_of_it(request_of, undisturbed, monkeypatch, harm):
    """The run keeps its steps; when the photographs are back, it ends with the same bits as an undisturbed run."""
    images, kept = request_of("run").capture / "images", request_of("run").capture / "kept"
    shutil.copytree(images, kept)
    take, steps = fit_module._take_step, itertools.count()

    def harmed(state, data, *rest):
        if next(steps) == 4:
            if harm == "vanishes":
                shutil.rmtree(images)
            else:
                for path in images.iterdir():
                    path.write_bytes((images / "000.png").read_bytes() + b"\0")
        take(state, data, *rest)

    # No decoded photograph is kept, as if they were larger than the cache.
    load = Capture.load
    monkeypatch.setattr(Capture, "load", lambda folder: load(folder, 0))
    with monkeypatch.context() as patch:
        patch.setattr(fit_module, "_take_step", harmed)
        with pytest.raises(InputError, match=r"images.00\d\.png: expected ") as caught:
            run_fit(request_of("run"), SHORT, CPU, Feedback())
    assert str(caught.value).count(". ") == 0
    assert torch.load(request_of("run").out / "checkpoint.pt", weights_only=True)["step"] == 4
    if harm == "changes":
        with pytest.raises(InputError, match="has changed since this run began"):
            run_fit(request_of("run", resume=True), SHORT, CPU, Feedback())
    shutil.rmtree(images, ignore_errors=True)
    kept.rename(images)
    assert run_fit(request_of("run", resume=True), SHORT, CPU, Feedback()).step == 6
    assert bits(request_of("run")) == undisturbed


def test_a_clock_that_is_set_back_changes_nothing(request_of, undisturbed, monkeypatch):
    hours = itertools.count(1e6, -3600)
    monkeypatch.setattr(time, "time", lambda: next(hours))
    run_fit(request_of("run"), SHORT, CPU, Feedback())
    assert bits(request_of("run")) == undisturbed


def test_progress_reaches_the_end(request_of):
    counted = CountedLoops()
    run_fit(request_of("run"), tiny_config(steps=4), CPU, Feedback(track=counted.track))
    assert all(loop.complete for loop in counted.loops)
    assert (counted.loops[-1].title, counted.loops[-1].total) == ("fitting", 4)
    assert {"smoothing growth directions", "spreading hair over its room"} < {loop.title for loop in counted.loops}


@pytest.mark.parametrize("stopped_at", [None, 6])
def test_the_log_has_the_figures_of_every_step_of_a_checkpoint(request_of, monkeypatch, stopped_at):
    config, out = tiny_config(steps=7, initialise="mean"), request_of("run").out
    save, take, seen = run_fit_module.save_checkpoint, fit_module._take_step, []

    def watched(state, path):
        seen.append((state.step, [int(row["step"]) for row in read_log(RunFolder(out).log)]))
        save(state, path)

    def stopping(state, *rest):
        if state.step == stopped_at:
            raise KeyboardInterrupt
        take(state, *rest)

    monkeypatch.setattr(run_fit_module, "steps_per_reading", lambda _: 3)
    monkeypatch.setattr(run_fit_module, "CHECKPOINT_SECONDS", -1.0)
    monkeypatch.setattr(run_fit_module, "save_checkpoint", watched)
    monkeypatch.setattr(fit_module, "_take_step", stopping)
    with pytest.raises(KeyboardInterrupt) if stopped_at else nullcontext():
        run_fit(request_of("run"), config, CPU, Feedback())
    assert [step for step, _ in seen] == [0, 3, 6, *([6] if stopped_at else [7, 7])]
    assert all(rows == list(range(1, step + 1)) for step, rows in seen)


def test_a_resumed_fit_traces_no_strands_again(request_of, monkeypatch):
    config = tiny_config(steps=4, initialise="flow")
    run_fit(request_of("whole"), config, CPU, Feedback())

    def stopped(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(fit_module, "_take_step", stopped)
        with pytest.raises(KeyboardInterrupt):
            run_fit(request_of("run"), config, CPU, Feedback())
    monkeypatch.setattr(first_model, "trace_first_strands", lambda *_: pytest.fail("traced again"))
    run_fit(request_of("run", resume=True), config, CPU, Feedback())
    assert bits(request_of("run")) == bits(request_of("whole"))


def test_stereo_that_finds_too_little_blocks_no_later_fit(tmp_path, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    segments = true_segments(write_capture(tmp_path / "ball"))
    request = FitRequest(tmp_path / "ball", tmp_path / "run")
    config = replace(tiny_config(), steps=2, initialise="mean")
    folder, said = RunFolder(request.out), []
    monkeypatch.setattr(run_fit_module, "find_segments", lambda *_: segments.select(torch.arange(20)))
    with pytest.raises(InputError, match="500 segment points or more, found 20"):
        run_fit(request, config, CPU, Feedback(said.append))
    assert not folder.description.exists()
    assert not folder.segments.exists()
    assert "line-based multi-view stereo over the training views" in said
    monkeypatch.setattr(run_fit_module, "find_segments", lambda *_: segments)
    assert run_fit(request, config, CPU, Feedback()).step == 2
    assert folder.description.is_file()


@pytest.mark.parametrize("initialise", ["flow", "mean"])
def test_the_forecast_counts_every_part_of_the_fit(request_of, monkeypatch, initialise):
    # Hours, so that nothing is rounded away.
    monkeypatch.setattr(forecast_module, "tracing_seconds", lambda *_: 7200.0)
    monkeypatch.setattr(run_fit_module, "FORECAST_FROM", 2)
    said = []
    run_fit(request_of("run"), tiny_config(steps=2, initialise=initialise), CPU, Feedback(said.append))
    (told,) = [line for line in said if line.startswith("expect about")]
    total, stereo, tracing, steps = map(float, re.findall(r"(\d+\.\d) (?:minutes|for)", told))
    assert total == pytest.approx(stereo + tracing + steps, abs=0.15)
    assert tracing == (120.0 if initialise == "flow" else 0.0)


@pytest.mark.parametrize(
    ("steps", "heard", "minutes", "forecasts"),
    [(99, True, None, 0), (100, True, None, 1), (100, False, None, 0), (2, False, 1.0, 1)],
)
def test_only_a_long_fit_that_is_followed_or_given_minutes_is_forecast(
    request_of, monkeypatch, steps, heard, minutes, forecasts
):
    made, said = [], []

    def stand_in(*arguments):
        made.append(arguments)
        return Forecast(0.0, 0.0, 10.0, 10.0, 0.0, 60.0, 10**9)

    monkeypatch.setattr(run_fit_module, "forecast", stand_in)
    feedback = Feedback(said.append) if heard else Feedback()
    config = tiny_config(steps=steps, initialise="mean")
    run = prepare_run(request_of("run", minutes=minutes), config, CPU, Workers.join(CPU), feedback)
    assert len(made) == forecasts
    assert sum(line.startswith("expect about") for line in said) == (forecasts if heard else 0)
    # Ten steps at least, whatever they cost.
    assert run.config.steps == (10 if minutes else steps)
