"""The encoder: its two kinds of mean, its inputs, its gradients."""

from dataclasses import replace

import pytest
import torch

from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.encoder import EncoderConfig, StrandEncoder
from neural_strands.prior.generator import GeneratorConfig, StrandGenerator
from neural_strands.prior.vae import load_prior


@pytest.fixture(scope="module")
def curves() -> torch.Tensor:
    return synthetic_curves(40, torch.Generator().manual_seed(0))


def test_features_do_not_depend_on_scale_but_for_the_length(curves: torch.Tensor) -> None:
    encoder = StrandEncoder(StrandGenerator())
    small, large = encoder.features(curves), encoder.features(2 * curves)
    torch.testing.assert_close(small[:, :6], large[:, :6], atol=1e-5, rtol=1e-4)
    assert (large[:, 6] > small[:, 6]).all()
    torch.testing.assert_close(small[:, 3:6].norm(dim=1), torch.ones(40, 99))


def test_the_cnn_alone_gives_mean_and_deviation_with_gradients(curves: torch.Tensor) -> None:
    generator = StrandGenerator(GeneratorConfig(modulator="mlp", layers=2))
    encoder = StrandEncoder(generator, EncoderConfig(analysis=False))
    mean, log_std = encoder(curves)
    assert mean.shape == log_std.shape == (40, 64)
    torch.testing.assert_close(log_std, torch.full_like(log_std, encoder.config.start_log_std))
    (mean.sum() + log_std.sum()).backward()
    assert encoder.mean.weight.grad is not None
    assert encoder.log_std.weight.grad is not None


def test_the_generator_is_not_part_of_the_encoder() -> None:
    names = StrandEncoder(StrandGenerator()).state_dict()
    assert all(name.split(".")[0] in ("trunk", "mean", "log_std") for name in names)


def test_the_mean_decodes_to_the_strand(curves: torch.Tensor) -> None:
    prior = load_prior()
    mean, log_std = prior.encoder(curves)
    assert 1000 * (prior.decode(mean) - curves).norm(dim=-1).mean() < 0.2
    assert (log_std < 0).all()


def test_another_number_of_points_is_refused(curves: torch.Tensor) -> None:
    encoder = StrandEncoder(StrandGenerator(), replace(EncoderConfig(), points=50))
    with pytest.raises(ValueError, match="must have 50 points, found 100"):
        encoder(curves)
