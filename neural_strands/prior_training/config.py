"""Settings of prior training: sizes, losses, steps; and the paper's preset."""

import math
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal

from neural_strands.foundation.errors import InputError
from neural_strands.prior.bounded_quantities import LONGEST, SHORTEST
from neural_strands.prior.curves import CurveConfig
from neural_strands.prior.encoder import EncoderConfig
from neural_strands.prior.generator import GeneratorConfig, raw_size
from neural_strands.prior.synthesiser import SynthesiserConfig

POINTS = 100
"""Points per training curve."""


@dataclass(frozen=True)
class PriorLossConfig:
    """Weights of the losses."""

    kind: Literal["relative", "paper", "absolute"] = "relative"
    """relative: errors in strand lengths; paper: squared distances in metres; absolute: the paper's terms with
    distances that are not squared (L1)."""
    direction: float = 1e-3
    """Weight of 1 - cosine in the paper's data term (lambda_d)."""
    curvature: float = 0.0
    """Weight of the squared error of the turns between segments, in addition to any data term."""
    kl: float = 3e-5
    """Weight of the KL term (lambda_KL; the paper: 1e-3)."""
    free_bits: float = 0.0
    """KL divergence per latent below which it is not penalised, nats."""


@dataclass(frozen=True)
class TrainPriorConfig:
    """Settings of training the strand prior."""

    steps: int = 10000
    """Steps of the last stage (of all, in the paper's preset); the learning rate falls to zero over them."""
    sine_steps: int = 1500
    """Steps of the second stage, which trains the synthesiser's sines."""
    start_curves: int = 20000
    """Number of curves for the closed-form start; 0 starts from random weights and skips the second stage."""
    batch: int = 512
    """Curves per step."""
    learning_rate: float = 2e-3
    """Highest learning rate of modulator and CNN."""
    sine_learning_rate: float = 5e-4
    """Highest learning rate of the synthesiser's sines."""
    own_share: float = 0.3
    """Share of the user's own strands among the curves, if there are any."""
    steps_a_chunk: int = 64
    """Steps between new curves: 2,048 of the 16,384 in use are replaced."""
    checkpoint_seconds: float = 60.0
    """Seconds between checkpoints."""
    curves: CurveConfig = field(default_factory=CurveConfig)
    """The synthetic curves."""
    loss: PriorLossConfig = field(default_factory=PriorLossConfig)
    """Weights of the losses."""
    generator: GeneratorConfig = field(default_factory=GeneratorConfig)
    """The decoder."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The encoder."""

    @property
    def stages(self) -> tuple[int, int]:
        """Number of steps of the second and the last stage; a random start skips the second."""
        return (self.sine_steps if self.start_curves else 0), self.steps


LEAST: dict[str, float] = {
    "steps": 0,
    "sine_steps": 0,
    "start_curves": 0,
    "batch": 2,
    "steps_a_chunk": 1,
    "checkpoint_seconds": 0,
    "loss.direction": 0,
    "loss.curvature": 0,
    "loss.kl": 0,
    "loss.free_bits": 0,
    "generator.latent": 1,
    "generator.hidden": 1,
    "generator.layers": 0,
    "generator.synthesiser.smooth": 1,
    "generator.synthesiser.sidebands": 1,
    "generator.synthesiser.warps": 1,
    "encoder.hidden": 1,
    "encoder.refine": 0,
}
"""Smallest values of options that have no other bound."""


def check_prior_config(config: TrainPriorConfig) -> None:
    """Reject settings that cannot be trained.

    Raises:
        InputError: an option is impossible; the message names the first.
    """
    for name, least in LEAST.items():
        value = _named(config, name)
        _expect(math.isfinite(value) and value >= least, name, f"at least {least:g}", value)
    for name in ("learning_rate", "sine_learning_rate"):
        value = _named(config, name)
        _expect(0 < value < math.inf, name, "a positive number", value)
    for name in ("own_share", "curves.smooth", "curves.wavy"):
        value = _named(config, name)
        _expect(0 <= value <= 1, name, "a share from 0 to 1", value)
    curves, generator, inner = config.curves, config.generator, config.generator.synthesiser
    low, high = curves.shortest, curves.longest
    _expect(SHORTEST <= low < LONGEST, "curves.shortest", f"{SHORTEST:g} to {LONGEST:g} metres", low)
    _expect(low < high <= LONGEST, "curves.longest", f"more than curves.shortest and at most {LONGEST:g} metres", high)
    _expect(curves.most_turns > 0, "curves.most_turns", "a positive number", curves.most_turns)
    _expect(
        max(inner.smooth, inner.warps) <= inner.carriers,
        "generator.synthesiser.carriers",
        "at least as many as smooth and warps",
        inner.carriers,
    )
    _expect(
        0 < inner.slowest < inner.fastest < math.inf,
        "generator.synthesiser.slowest",
        "a positive number below fastest",
        inner.slowest,
    )
    _expect(config.encoder.points == POINTS, "encoder.points", f"{POINTS}, as the curves have", config.encoder.points)
    deepest = int(math.log2(POINTS - 1))
    widths = config.encoder.widths
    _expect(
        0 < len(widths) <= deepest and min(widths) > 0, "encoder.widths", f"1 to {deepest} positive numbers", widths
    )
    coupling = generator.modulator == "coupling"
    _expect(not coupling or generator.latent % 2 == 0, "generator.latent", "an even number", generator.latent)
    _expect(coupling or not config.encoder.analysis, "encoder.analysis", "False for a modulator without inverse", True)
    raw = raw_size(inner)
    closed = config.start_curves > 0 or config.encoder.analysis
    _expect(
        not closed or generator.latent == raw,
        "generator.latent",
        f"{raw}, for a start or encoder in closed form",
        generator.latent,
    )
    _expect(
        config.start_curves == 0 or config.start_curves > raw,
        "start_curves",
        f"0 or more than {raw}",
        config.start_curves,
    )


def _expect(fine: bool, name: str, expected: str, found: object) -> None:
    if not fine:
        raise InputError(f"--config.{name.replace('_', '-')}: expected {expected}, found {found}.")


def _named(config: Any, name: str) -> int | float:
    """The value of a setting by its dotted name."""
    for part in name.split("."):
        config = getattr(config, part)
    return config


def paper_preset(given: TrainPriorConfig) -> TrainPriorConfig:
    """The paper's modulator (an MLP), encoder (a CNN alone), Euler sum, losses and weights, from a random start.

    Fields that `given` changes from our default keep their value, so that one thing at a time can be changed.
    """
    paper = TrainPriorConfig(
        start_curves=0,
        generator=GeneratorConfig(modulator="mlp", layers=3, synthesiser=SynthesiserConfig(integration="euler")),
        encoder=EncoderConfig(analysis=False, widths=(32, 32, 64, 128, 128)),
        loss=PriorLossConfig(kind="paper", direction=1e-3, kl=1e-3),
    )
    return _changed(paper, TrainPriorConfig(), given)


def _changed(preset: Any, default: Any, given: Any) -> Any:
    """The preset, with every field in which `given` differs from the default taken from `given`."""
    if is_dataclass(given) and not isinstance(given, type):
        names = [each.name for each in fields(given)]
        return replace(
            preset, **{name: _changed(*(getattr(each, name) for each in (preset, default, given))) for name in names}
        )
    return preset if given == default else given
