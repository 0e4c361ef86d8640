"""Settings that the training of the prior rejects."""

from dataclasses import replace

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.prior.curves import CurveConfig
from neural_strands.prior.encoder import EncoderConfig
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.synthesiser import SynthesiserConfig
from neural_strands.prior_training.config import PriorLossConfig, TrainPriorConfig, check_prior_config, paper_preset


@pytest.mark.parametrize("config", [TrainPriorConfig(), paper_preset(TrainPriorConfig())], ids=["default", "paper"])
def test_the_presets_pass(config: TrainPriorConfig) -> None:
    check_prior_config(config)


def test_latents_are_free_where_nothing_is_in_closed_form() -> None:
    check_prior_config(paper_preset(TrainPriorConfig(generator=GeneratorConfig(latent=32))))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"steps": -3}, "--config.steps: expected at least 0, found -3."),
        ({"batch": 0}, "--config.batch: expected at least 2, found 0."),
        ({"steps_a_chunk": 0}, "--config.steps-a-chunk: expected at least 1, found 0."),
        ({"learning_rate": float("nan")}, "--config.learning-rate: expected a positive number, found nan."),
        ({"sine_learning_rate": 0.0}, "--config.sine-learning-rate: expected a positive number, found 0.0."),
        ({"own_share": 1.5}, "--config.own-share: expected a share from 0 to 1, found 1.5."),
        ({"start_curves": 64}, "--config.start-curves: expected 0 or more than 64, found 64."),
        ({"loss": PriorLossConfig(kl=-1.0)}, "--config.loss.kl: expected at least 0, found -1.0."),
        ({"curves": CurveConfig(shortest=0.0)}, "--config.curves.shortest: expected 0.003 to 2 metres, found 0.0."),
        (
            {"curves": CurveConfig(longest=0.01)},
            "--config.curves.longest: expected more than curves.shortest and at most 2 metres, found 0.01.",
        ),
        ({"curves": CurveConfig(most_turns=0.0)}, "--config.curves.most-turns: expected a positive number, found 0.0."),
        ({"encoder": EncoderConfig(points=50)}, "--config.encoder.points: expected 100, as the curves have, found 50."),
        ({"encoder": EncoderConfig(widths=())}, "--config.encoder.widths: expected 1 to 6 positive numbers, found ()."),
        ({"generator": GeneratorConfig(latent=63)}, "--config.generator.latent: expected an even number, found 63."),
        (
            {"generator": GeneratorConfig(latent=32)},
            "--config.generator.latent: expected 64, for a start or encoder in closed form, found 32.",
        ),
        (
            {"generator": GeneratorConfig(modulator="mlp")},
            "--config.encoder.analysis: expected False for a modulator without inverse, found True.",
        ),
        (
            {"generator": GeneratorConfig(synthesiser=SynthesiserConfig(carriers=5))},
            "--config.generator.synthesiser.carriers: expected at least as many as smooth and warps, found 5.",
        ),
        (
            {"generator": GeneratorConfig(synthesiser=SynthesiserConfig(slowest=40.0))},
            "--config.generator.synthesiser.slowest: expected a positive number below fastest, found 40.0.",
        ),
    ],
)
def test_what_cannot_be_trained_is_named(changed: dict, message: str) -> None:
    with pytest.raises(InputError) as caught:
        check_prior_config(replace(TrainPriorConfig(), **changed))
    assert str(caught.value) == message
