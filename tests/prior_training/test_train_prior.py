"""Training of the prior: it learns, resumes to the same bits, and refuses what it cannot resume."""

import itertools
import json
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.gradients import Adam
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.synthesiser import SynthesiserConfig
from neural_strands.prior.vae import StrandPrior, load_prior
from neural_strands.prior_training import curve_stream
from neural_strands.prior_training import train_prior as module
from neural_strands.prior_training.config import PriorLossConfig, TrainPriorConfig, paper_preset
from neural_strands.prior_training.train_prior import held_out_curves, held_out_error, learning_rate, train_prior

TINY = TrainPriorConfig(
    steps=8,
    sine_steps=3,
    start_curves=200,
    batch=16,
    steps_a_chunk=4,
    checkpoint_seconds=0.0,
    generator=GeneratorConfig(layers=2, hidden=16),
)
ONE = replace(TINY, steps=1, sine_steps=0)


@pytest.fixture(autouse=True, scope="module")
def small() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curve_stream, "CHUNK", 64)
        patch.setattr(module, "HELD_OUT", 32)
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, small: None) -> tuple[Path, StrandPrior]:
    """The weights' file and the prior of a run that nothing stopped."""
    out = tmp_path_factory.mktemp("whole") / "prior.safetensors"
    return out, train_prior(out, TINY, seed=1)


class Killed(BaseException):
    """What stops a run at a step of the test's choice."""


def killed_at(step: int, stage: int, out: Path, config: TrainPriorConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    advance = module._advance

    def stopping(run, losses, steps):
        if run.stage == stage and run.step == step:
            raise Killed
        return advance(run, losses, steps)

    with monkeypatch.context() as patch:
        patch.setattr(module, "_advance", stopping)
        with pytest.raises(Killed):
            train_prior(out, config, seed=1)


@pytest.mark.parametrize(("stage", "step"), [(0, 2), (1, 5)])
def test_a_killed_run_resumes_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: tuple[Path, StrandPrior], stage: int, step: int
) -> None:
    out = tmp_path / "killed.safetensors"
    killed_at(step, stage, out, TINY, monkeypatch)
    resumed = train_prior(out, TINY, seed=1, resume=True)
    for name, value in whole[1].state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name
    again = load_prior(out)
    assert torch.equal(again.generator.linear.weight, whole[1].generator.linear.weight)


def test_the_default_trains_every_part_and_logs(whole: tuple[Path, StrandPrior]) -> None:
    out, prior = whole
    assert held_out_error(prior, held_out_curves(1, TINY.curves)) < 0.5
    coupling = dict(prior.generator.modulator.named_parameters())
    assert coupling["networks.0.4.weight"].abs().max() > 0
    assert prior.encoder.log_std.weight.abs().max() > 0
    lines = [json.loads(line) for line in out.with_suffix(".log.jsonl").read_text().splitlines()]
    assert {"stage", "step", "held_out_mm", "seconds"} <= set(lines[-1])
    assert any("likelihood" in line for line in lines)


def test_the_paper_preset_learns(tmp_path: Path) -> None:
    config = paper_preset(replace(TINY, steps=150, batch=64, learning_rate=5e-3, checkpoint_seconds=1e9))
    assert config.loss.kl == 1e-3
    assert config.loss.direction == 1e-3
    assert config.generator.modulator == "mlp"
    assert not config.encoder.analysis
    curves = held_out_curves(0, config.curves)
    start = held_out_error(train_prior(tmp_path / "a.safetensors", replace(config, steps=1)), curves)
    assert held_out_error(train_prior(tmp_path / "b.safetensors", config), curves) < 0.9 * start


def test_the_paper_preset_keeps_what_was_changed() -> None:
    given = replace(
        TINY,
        loss=PriorLossConfig(kind="absolute", free_bits=0.25),
        generator=GeneratorConfig(synthesiser=SynthesiserConfig(output="position")),
    )
    config = paper_preset(given)
    assert (config.loss.kind, config.loss.free_bits, config.loss.kl) == ("absolute", 0.25, 1e-3)
    assert config.generator.synthesiser == SynthesiserConfig(output="position", integration="euler")
    assert config.generator.modulator == "mlp"
    assert (config.steps, config.batch, config.start_curves) == (TINY.steps, TINY.batch, TINY.start_curves)
    assert paper_preset(TrainPriorConfig()).start_curves == 0


@pytest.mark.parametrize(
    "changed",
    [
        {"loss": PriorLossConfig(kind="absolute", curvature=1e-2, free_bits=0.25)},
        {"start_curves": 200},
        {"generator": GeneratorConfig(synthesiser=SynthesiserConfig(modulation="amplitude"))},
        {"generator": GeneratorConfig(synthesiser=SynthesiserConfig(output="position"))},
    ],
    ids=["losses", "whitened", "amplitude", "position"],
)
def test_each_change_of_the_paper_preset_trains_all_weights(tmp_path: Path, changed: dict) -> None:
    config = paper_preset(TrainPriorConfig(steps=2, batch=16, steps_a_chunk=4, **changed))
    config = replace(config, sine_steps=0)
    first = train_prior(tmp_path / "first.safetensors", replace(config, steps=1)).state_dict()
    second = train_prior(tmp_path / "second.safetensors", config).state_dict()
    same = {name for name, value in first.items() if torch.equal(value, second[name])}
    # With amplitudes alone there is no chirp, so nothing depends on the mix that bends the phase.
    amplitude = config.generator.synthesiser.modulation == "amplitude"
    assert same == ({"generator.synthesiser.warp_mix"} if amplitude else set())


def test_a_loss_that_is_not_finite_stops_training_and_leaves_the_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: tuple[Path, StrandPrior]
) -> None:
    out = tmp_path / "prior.safetensors"
    measure = module.relative_loss
    calls = iter(range(100))

    def diverging(decoded, true):
        return measure(decoded, true) * (torch.nan if next(calls) >= 2 else 1)

    with monkeypatch.context() as patch:
        patch.setattr(module, "relative_loss", diverging)
        with pytest.raises(
            InputError, match=r"expected finite losses at step 2, found .*'data': nan.*; lower the learn"
        ):
            train_prior(out, TINY, seed=1)
    resumed = train_prior(out, TINY, seed=1, resume=True)
    assert torch.equal(resumed.generator.linear.weight, whole[1].generator.linear.weight)


def test_the_loss_of_the_sines_is_the_configured_one(tmp_path: Path) -> None:
    one = replace(TINY, steps=0, sine_steps=1)
    plain = train_prior(tmp_path / "a.safetensors", one)
    curved = train_prior(tmp_path / "b.safetensors", replace(one, loss=PriorLossConfig(curvature=1.0)))
    phases = [prior.generator.synthesiser.unit_phase for prior in (plain, curved)]
    assert not torch.equal(*phases)


def test_minutes_stop_a_run_that_resume_finishes(tmp_path: Path) -> None:
    out = tmp_path / "prior.safetensors"
    train_prior(out, TINY, seed=1, minutes=0.0)
    last = json.loads(out.with_suffix(".log.jsonl").read_text().splitlines()[-1])
    assert (last["stage"], last["step"]) == (0, 1)
    train_prior(out, TINY, seed=1, resume=True)
    last = json.loads(out.with_suffix(".log.jsonl").read_text().splitlines()[-1])
    assert (last["stage"], last["step"]) == (1, 8)


def test_resume_refuses_what_does_not_fit(tmp_path: Path) -> None:
    out = tmp_path / "prior.safetensors"
    with pytest.raises(InputError, match="expected a checkpoint to resume from, found no file"):
        train_prior(out, TINY, resume=True)
    train_prior(out, ONE, seed=1)
    with pytest.raises(InputError, match="another configuration or seed"):
        train_prior(out, ONE, seed=2, resume=True)
    checkpoint = out.with_suffix(".checkpoint.pt")
    checkpoint.write_bytes(checkpoint.read_bytes()[:1000])
    with pytest.raises(InputError, match="expected a complete checkpoint, found something else"):
        train_prior(out, TINY, seed=1, resume=True)


@pytest.mark.parametrize("interrupted_step", [2, 4, 9])
def test_an_interrupted_run_resumes_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: tuple[Path, StrandPrior], interrupted_step: int
) -> None:
    """Ctrl-C between the optimiser's update and the counter, in either stage and at the change between them."""
    out, calls = tmp_path / "prior.safetensors", itertools.count(1)
    update = Adam.step

    def interrupted(*arguments):
        update(*arguments)
        if next(calls) == interrupted_step:
            signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(Adam, "step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train_prior(out, TINY, seed=1)
    resumed = train_prior(out, TINY, seed=1, resume=True)
    for (name, ours), theirs in zip(resumed.state_dict().items(), whole[1].state_dict().values(), strict=True):
        assert torch.equal(ours, theirs), name


GARBAGE = {
    "a list": lambda content: content.update(prior=[1, 2]),
    "nothing": lambda content: content["prior"].update({"generator.linear.weight": None}),
    "no moments": lambda content: content["optimiser"].update(state=None),
    "a stage": lambda content: content.update(stage=3),
    "a step": lambda content: content.update(step=10**9),
    "no step": lambda content: content.pop("step"),
    "no text": lambda content: content.update(described=None),
}


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory, small: None) -> Path:
    """The checkpoint of a run of one step."""
    out = tmp_path_factory.mktemp("one") / "prior.safetensors"
    train_prior(out, ONE, seed=1)
    return out.with_suffix(".checkpoint.pt")


@pytest.mark.parametrize("name", sorted(GARBAGE))
def test_garbage_in_a_checkpoint_is_one_sentence(tmp_path: Path, checkpoint: Path, name: str) -> None:
    content = torch.load(checkpoint, weights_only=True)
    GARBAGE[name](content)
    torch.save(content, tmp_path / checkpoint.name)
    with pytest.raises(InputError, match="expected a complete checkpoint, found something else"):
        train_prior(tmp_path / "prior.safetensors", ONE, seed=1, resume=True)


def test_the_learning_rate_rises_and_falls_to_zero() -> None:
    assert learning_rate(0, 1000) == pytest.approx(0.01, rel=1e-3)
    assert learning_rate(500, 1000) == pytest.approx(0.5)
    assert learning_rate(1000, 1000) == pytest.approx(0, abs=1e-6)
