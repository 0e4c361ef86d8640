"""The closed-form start."""

import pytest
import torch

from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.generator import GeneratorConfig
from neural_strands.prior.vae import StrandPrior
from neural_strands.prior.whiten import start_from_curves, whitening


def test_whitened_samples_have_unit_covariance(generator: torch.Generator) -> None:
    samples = torch.randn(5000, 4, generator=generator) @ torch.randn(4, 4, generator=generator) + 3
    mean, factor = whitening(samples)
    white = torch.linalg.solve(factor, (samples - mean).T)
    torch.testing.assert_close(white @ white.T / 5000, torch.eye(4), atol=1e-3, rtol=0)
    assert torch.equal(factor, factor.tril())


def test_the_start_gives_white_latents_and_exact_strands() -> None:
    curves = synthetic_curves(600, torch.Generator().manual_seed(0))
    prior = StrandPrior().requires_grad_(False)
    start_from_curves(prior.generator, curves)
    latent = prior.encode(curves)
    torch.testing.assert_close(latent.T @ latent / len(latent), torch.eye(64), atol=0.02, rtol=0)
    assert 1000 * (prior.decode(latent) - curves).norm(dim=-1).mean() < 0.2


def test_another_latent_size_is_refused() -> None:
    prior = StrandPrior(GeneratorConfig(latent=32))
    with pytest.raises(ValueError, match=r"as many latents as raw quantities .64., found 32"):
        start_from_curves(prior.generator, synthetic_curves(10, torch.Generator().manual_seed(0)))
