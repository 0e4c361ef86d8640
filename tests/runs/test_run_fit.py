"""A fit as a run: a refused fit leaves nothing that blocks the next one."""

import itertools
import re
import shutil
import time
from dataclasses import replace

import pytest
import torch
from counted_loops import CountedLoops
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.fitting import first_model
from neural_strands.fitting import fit as fit_module
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import sole_writer
from neural_strands.foundation.progress import Feedback
from neural_strands.lmvs.files import save_segments
from neural_strands.runs import forecast as forecast_module
from neural_strands.runs import run_fit as run_fit_module
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.runs.run_folder import RunFolder

CPU = torch.device("cpu")


@pytest.fixture
def request_of(tmp_path, monkeypatch):
    """Asks for a fit of a small capture into a folder of this name."""
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    save_segments(tmp_path / "segments.npz", true_segments(write_capture(tmp_path / "ball", views=4)))

    def made(name, **changes):
        request = FitRequest(tmp_path / "ball", tmp_path / name, segments=tmp_path / "segments.npz")
        return replace(request, **changes)

    return made


def bits(request) -> dict[str, bytes]:
    names = ("model/model.safetensors", "groom.npz", "groom.usd")
    return {name: (request.out / name).read_bytes() for name in names}


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
def test_a_capture_that_is_harmed_under_a_fit_costs_nothing_of_it(request_of, monkeypatch, harm):
    """The run keeps its steps; when the photographs are back, it ends with the same bits as an undisturbed run."""
    config = tiny_config(steps=6)
    run_fit(request_of("whole"), config, CPU, Feedback())
    images, kept = request_of("run").capture / "images", request_of("run").capture / "kept"
    shutil.copytree(images, kept)
    take, steps = fit_module._take_step, itertools.count()

    def harmed(state, data, *rest):
        # The forecast also takes steps, before the run exists.
        if request_of("run").out.joinpath("run.json").is_file() and next(steps) == 4:
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
            run_fit(request_of("run"), config, CPU, Feedback())
    assert str(caught.value).count(". ") == 0
    assert torch.load(request_of("run").out / "checkpoint.pt", weights_only=True)["step"] == 4
    if harm == "changes":
        with pytest.raises(InputError, match="has changed since this run began"):
            run_fit(request_of("run", resume=True), config, CPU, Feedback())
    shutil.rmtree(images, ignore_errors=True)
    kept.rename(images)
    assert run_fit(request_of("run", resume=True), config, CPU, Feedback()).step == 6
    assert bits(request_of("run")) == bits(request_of("whole"))


def test_a_clock_that_is_set_back_changes_nothing(request_of, monkeypatch):
    config = tiny_config(steps=4, initialise="mean")
    run_fit(request_of("whole"), config, CPU, Feedback())
    hours = itertools.count(1e6, -3600)
    monkeypatch.setattr(time, "time", lambda: next(hours))
    run_fit(request_of("run"), config, CPU, Feedback())
    assert bits(request_of("run")) == bits(request_of("whole"))


def test_progress_reaches_the_end(request_of):
    counted = CountedLoops()
    run_fit(request_of("run"), tiny_config(steps=4), CPU, Feedback(track=counted.track))
    assert all(loop.complete for loop in counted.loops)
    assert (counted.loops[-1].title, counted.loops[-1].total) == ("fitting", 4)
    assert {"smoothing growth directions", "spreading hair over its room"} < {loop.title for loop in counted.loops}


def test_a_resumed_fit_traces_no_strands_again(request_of, monkeypatch):
    config = tiny_config(steps=4, initialise="flow")
    run_fit(request_of("whole"), config, CPU, Feedback())
    take = fit_module._take_step

    def stopped(*arguments):
        if request_of("run").out.joinpath("run.json").is_file():
            raise KeyboardInterrupt
        take(*arguments)

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
    said = []
    run_fit(request_of("run"), tiny_config(steps=2, initialise=initialise), CPU, Feedback(said.append))
    (told,) = [line for line in said if line.startswith("expect about")]
    total, stereo, tracing, steps = map(float, re.findall(r"(\d+\.\d) (?:minutes|for)", told))
    assert total == pytest.approx(stereo + tracing + steps, abs=0.15)
    assert tracing == (120.0 if initialise == "flow" else 0.0)
