"""What the training of the strand prior is told: sizes, losses, steps; and the paper's settings."""

from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal

from neural_strands.prior.curves import CurveConfig
from neural_strands.prior.encoder import EncoderConfig
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.synthesiser import SynthesiserConfig


@dataclass(frozen=True)
class PriorLossConfig:
    """Weights of the losses."""

    kind: Literal["relative", "paper", "absolute"] = "relative"
    """Errors in strand lengths; the paper's squared distances in metres; or its terms with distances that are not
    squared (L1)."""
    direction: float = 1e-3
    """Weight of 1 - cosine in the paper's data term (lambda_d)."""
    curvature: float = 0.0
    """Weight of the squared error of turns from segment to segment, beside any data term."""
    kl: float = 3e-5
    """Weight of the KL term (lambda_KL; the paper: 1e-3)."""
    free_bits: float = 0.0
    """KL a latent below which it is not counted, nats."""


@dataclass(frozen=True)
class TrainPriorConfig:
    """How the strand prior is trained."""

    steps: int = 10000
    """Steps of the last stage (of all, in the paper's preset); the learning rate falls to zero over them."""
    sine_steps: int = 1500
    """Steps of the second stage, which trains the synthesiser's sines."""
    start_curves: int = 20000
    """Curves of the closed-form start; 0 starts from random weights and skips the second stage."""
    batch: int = 512
    """Curves a step."""
    learning_rate: float = 2e-3
    """Highest learning rate of modulator and CNN."""
    sine_learning_rate: float = 5e-4
    """Highest learning rate of the synthesiser's sines."""
    own_share: float = 0.3
    """Share of the user's own strands among the curves, where there are any."""
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


def paper_preset(given: TrainPriorConfig) -> TrainPriorConfig:
    """The paper's modulator (an MLP), encoder (a CNN alone), Euler sum, losses and weights, from a random start.

    What `given` sets to something else than our default stays as given: the paper with one thing changed.
    """
    paper = TrainPriorConfig(
        start_curves=0,
        sine_steps=0,
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
