"""Training of the strand prior (paper, "Training / Strand Generator").

The default has three stages: a closed-form start from the curves (`prior.whiten`); training of the synthesiser's sines
by the error that the analysis leaves; then training of the modulator, by the likelihood of the curves' latents under
N(0, I), and of the CNN, by the error of strands decoded from noisy latents and the KL term. The `paper` preset trains
everything together from a random start with the paper's losses. Every random number is a function of seed and step, so
a resumed run gives exactly the same weights as an uninterrupted one.
"""

import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file, check_writable, tensor_bytes
from neural_strands.foundation.gradients import Adam
from neural_strands.foundation.interrupts import whole_steps
from neural_strands.foundation.progress import progress_bar
from neural_strands.foundation.tensor_files import adam_state, difference, read_tensors, restore_adam
from neural_strands.prior.analysis import analyse
from neural_strands.prior.curves import CurveConfig, synthetic_curves
from neural_strands.prior.vae import StrandPrior, save_prior
from neural_strands.prior.whiten import start_from_curves, white_from_curves
from neural_strands.prior_training.config import PriorLossConfig, TrainPriorConfig, check_prior_config
from neural_strands.prior_training.curve_stream import CurveStream, keyed_generator
from neural_strands.prior_training.losses import (
    absolute_loss,
    gaussian_likelihood,
    kl_divergence,
    paper_loss,
    relative_loss,
    turn_loss,
)

HELD_OUT = 512
"""Number of held-out curves whose error the progress bar shows."""
NOISY = 32
"""Curves per batch that are also decoded from noisy latents in the last stage of the default."""


@dataclass
class _Run:
    """Everything that a checkpoint stores."""

    prior: StrandPrior
    optimiser: torch.optim.Adam
    stage: int = 0
    step: int = 0


def train_prior(
    out: Path,
    config: TrainPriorConfig,
    *,
    seed: int = 0,
    minutes: float | None = None,
    resume: bool = False,
    own: Float[Tensor, "strand 100 3"] | None = None,
    device: torch.device | str = "cpu",
    notes: dict[str, str] | None = None,
) -> StrandPrior:
    """Train a prior and write its weights to `out` (safetensors), with a checkpoint and a log beside it.

    Args:
        out: file of the weights, which is written at every checkpoint.
        config: sizes, losses, steps.
        seed: seed of all random numbers.
        minutes: wall time after which training stops early; `resume` continues from there.
        resume: continue from the checkpoint beside `out`.
        own: the user's strands in local metres, added to the synthetic curves.
        device: where to train.
        notes: how the weights are made, stored in the file.

    Raises:
        InputError: the configuration is impossible, there is nothing to resume, the checkpoint has another
            configuration or seed, a loss is not finite, or `out` cannot be written.
    """
    check_prior_config(config)
    check_writable(out)
    began = time.monotonic()
    described = json.dumps({"config": asdict(config), "seed": seed}, sort_keys=True)
    weights = keyed_generator(seed, 2)
    prior = _initialised(config, weights).to(device)
    stream = CurveStream(seed, config.curves, own, config.own_share, config.steps_a_chunk, lambda curves: curves[:, :0])
    held_out = held_out_curves(seed, config.curves).to(device)
    checkpoint = out.with_suffix(".checkpoint.pt")
    run = _Run(prior, _optimiser(prior, config, 0))
    if resume:
        _load_checkpoint(checkpoint, run, config, described)
    elif config.start_curves:
        start_from_curves(prior.generator, stream.draw(config.start_curves, 4).to(device), config.encoder.refine)
    saved = began
    try:
        with progress_bar() as bar:
            task = bar.add_task("train-prior", total=sum(config.stages))
            for losses in whole_steps(_steps(run, config, stream, torch.device(device))):
                done = run.step + sum(config.stages[: run.stage])
                late = minutes is not None and time.monotonic() - began > 60 * minutes
                if late or time.monotonic() - saved > config.checkpoint_seconds:
                    error = held_out_error(prior, held_out)
                    bar.update(task, description=f"train-prior, held-out error {error:.3f} mm")
                    _save(out, checkpoint, run, described, notes or {})
                    _log(out, run, {**losses, "held_out_mm": error, "seconds": round(time.monotonic() - began, 1)})
                    saved = time.monotonic()
                bar.update(task, completed=done)
                if late:
                    return prior
    except KeyboardInterrupt:
        _save(out, checkpoint, run, described, notes or {})
        raise
    _save(out, checkpoint, run, described, notes or {})
    final = {"held_out_mm": held_out_error(prior, held_out), "seconds": round(time.monotonic() - began, 1)}
    _log(out, run, final)
    return prior


def held_out_curves(seed: int, config: CurveConfig) -> Float[Tensor, "strand 100 3"]:
    """Synthetic curves that a run with this seed never trains on."""
    return synthetic_curves(HELD_OUT, keyed_generator(seed, 3), config)


@torch.no_grad()
def held_out_error(prior: StrandPrior, curves: Float[Tensor, "strand point 3"]) -> float:
    """Mean point error of encoded and decoded curves, millimetres."""
    return 1000 * float((prior.decode(prior.encode(curves)) - curves).norm(dim=-1).mean())


def _steps(
    run: _Run, config: TrainPriorConfig, stream: CurveStream, device: torch.device
) -> Iterator[dict[str, float]]:
    """Take the remaining steps, yielding the losses of each."""
    prior = run.prior
    if run.stage == 0:
        while run.step < config.stages[0]:
            curves, _ = stream.batch(run.step, config.batch // 2)
            loss = _sine_loss(prior, curves.to(device), config.loss)
            yield _advance(run, {"data": loss}, config.stages[0])
        if config.start_curves:
            white_from_curves(prior.generator, stream.draw(config.start_curves, 4).to(device), config.encoder.refine)
        run.stage, run.step, run.optimiser = 1, 0, _optimiser(prior, config, 1)
    closed = config.encoder.analysis

    def raw_quantities(curves: Tensor) -> Tensor:
        return analyse(prior.generator, curves.to(device), config.encoder.refine).flat()

    stream = replace(stream, prepare=raw_quantities if closed else stream.prepare, seed=stream.seed + 1)
    while run.step < config.steps:
        curves, raw = stream.batch(run.step, config.batch)
        noise_size = min(NOISY, config.batch) if closed else config.batch
        noise = torch.randn(noise_size, config.generator.latent, generator=keyed_generator(stream.seed, 5, run.step))
        losses = _vae_losses(prior, curves[:noise_size].to(device), noise.to(device), config.loss)
        if closed:
            losses["likelihood"] = gaussian_likelihood(*prior.generator.latent(raw))
        yield _advance(run, losses, config.steps)


def _sine_loss(
    prior: StrandPrior, curves: Float[Tensor, "strand point 3"], weights: PriorLossConfig
) -> Float[Tensor, ""]:
    """Error that remains after the closed-form analysis; its gradient reaches the sines (amplitudes are optimal)."""
    generator = prior.generator
    raw = analyse(generator, curves, prior.encoder.config.refine)
    return _data_loss(generator.synthesiser(generator.modulations(raw), curves.shape[1]), curves, weights)


def _vae_losses(
    prior: StrandPrior,
    curves: Float[Tensor, "strand point 3"],
    noise: Float[Tensor, "strand latent"],
    weights: PriorLossConfig,
) -> dict[str, Tensor]:
    """Data and KL terms of strands decoded from sampled latents."""
    decoded, mean, log_std = prior(curves, noise)
    kl = weights.kl * kl_divergence(mean, log_std, weights.free_bits)
    return {"data": _data_loss(decoded, curves, weights), "kl": kl}


def _data_loss(
    decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"], weights: PriorLossConfig
) -> Float[Tensor, ""]:
    """Data term of the configured kind, plus the weighted error of turns if its weight is not 0."""
    if weights.kind == "relative":
        data = relative_loss(decoded, true)
    else:
        measure = paper_loss if weights.kind == "paper" else absolute_loss
        data = measure(decoded, true, weights.direction)
    return data + weights.curvature * turn_loss(decoded, true) if weights.curvature else data


def _advance(run: _Run, losses: dict[str, Tensor], steps: int) -> dict[str, float]:
    """One optimiser step at the cosine schedule's learning rate.

    Raises:
        InputError: a loss is not finite.
    """
    total = torch.stack(list(losses.values()))
    values = dict(zip(losses, total.tolist(), strict=True))
    if not all(math.isfinite(value) for value in values.values()):
        raise InputError(
            f"training: expected finite losses at step {run.step}, found {values}; lower the learning rate and resume "
            "from the last checkpoint, or start again."
        )
    for group in run.optimiser.param_groups:
        group["lr"] = group["highest"] * learning_rate(run.step, steps)
    run.optimiser.zero_grad(set_to_none=True)
    total.sum().backward()
    parameters = [value for group in run.optimiser.param_groups for value in group["params"]]
    torch.nn.utils.clip_grad_norm_(parameters, 5.0)
    run.optimiser.step()
    run.step += 1
    return values


def learning_rate(step: int, steps: int, warm: int = 100) -> float:
    """Share of the highest learning rate: a linear rise, then half a cosine down to 0."""
    rise = min(1.0, (step + 1) / warm)
    return rise * 0.5 * (1 + float(torch.cos(torch.tensor(torch.pi * step / max(steps, 1)))))


def _optimiser(prior: StrandPrior, config: TrainPriorConfig, stage: int) -> torch.optim.Adam:
    """The parameters that a stage trains: the sines; then modulator and CNN; or all together (the paper).

    In the last stage the sines and the linear map stay fixed only because of the closed-form analysis.
    """
    if not config.start_curves or (stage == 1 and not config.encoder.analysis):
        chosen, rate = list(prior.parameters()), config.learning_rate
    elif stage == 0:
        chosen, rate = list(prior.generator.synthesiser.parameters()), config.sine_learning_rate
    else:
        chosen = [*prior.generator.modulator.parameters(), *prior.encoder.parameters()]
        rate = config.learning_rate
    return Adam([{"params": chosen, "lr": rate, "highest": rate}])


def _initialised(config: TrainPriorConfig, generator: torch.Generator) -> StrandPrior:
    """A prior whose random weights come from the generator, uniform within 1/sqrt(inputs) as in torch."""
    prior = StrandPrior(config.generator, config.encoder)
    with torch.no_grad():
        for module in prior.modules():
            if isinstance(module, torch.nn.Linear | torch.nn.Conv1d) and module.weight.abs().max() > 0:
                bound = module.weight[0].numel() ** -0.5
                module.weight.uniform_(-bound, bound, generator=generator)
                if module.bias is not None:
                    module.bias.uniform_(-bound, bound, generator=generator)
    return prior


def _save(out: Path, checkpoint: Path, run: _Run, described: str, notes: dict[str, str]) -> None:
    """Write the checkpoint and the weights, each atomically."""
    with atomic_file(checkpoint) as temporary:
        temporary.write_bytes(tensor_bytes(_content(run, described)))
    save_prior(run.prior, out, {**notes, "training": described, "stage": str(run.stage), "step": str(run.step)})


def _content(run: _Run, described: str) -> dict[str, Any]:
    """The contents of a checkpoint."""
    return {
        "described": described,
        "stage": run.stage,
        "step": run.step,
        "prior": run.prior.state_dict(),
        "optimiser": adam_state(run.optimiser),
    }


def _load_checkpoint(path: Path, run: _Run, config: TrainPriorConfig, described: str) -> None:
    if not path.is_file():
        raise InputError(f"{path}: expected a checkpoint to resume from, found no file; train without --resume first.")
    # Adam's step counters stay on the CPU; its moments follow the weights to their device.
    state = read_tensors(path, "a complete checkpoint", "train without --resume")
    head = state if isinstance(state, dict) else {}
    if isinstance(head.get("described"), str) and head["described"] != described:
        raise InputError(
            f"{path}: the checkpoint was made with another configuration or seed; repeat those or drop --resume."
        )
    optimiser = _optimiser(run.prior, config, 1 if head.get("stage") == 1 else 0)
    fault = difference(state, _content(run, described) | {"optimiser": optimiser}, "checkpoint")
    if fault is None and not (state["stage"] in (0, 1) and 0 <= state["step"] <= config.stages[state["stage"]]):
        fault = f"step {state['step']} of stage {state['stage']}"
    if fault is not None:
        raise InputError(
            f"{path}: expected a complete checkpoint, found something else ({fault}); train without --resume."
        )
    run.stage, run.step, run.optimiser = state["stage"], state["step"], optimiser
    run.prior.load_state_dict(state["prior"])
    restore_adam(run.optimiser, state["optimiser"])


def _log(out: Path, run: _Run, values: dict[str, float]) -> None:
    """Append one line to the run's log."""
    line = json.dumps({"stage": run.stage, "step": run.step, **values})
    with out.with_suffix(".log.jsonl").open("a") as file:
        file.write(line + "\n")
