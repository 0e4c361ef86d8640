"""Traversal finds the directions that were put there."""

import pytest
import torch
from torch import Tensor, nn

from neural_strands.prior.curves import CurveConfig, synthetic_curves
from neural_strands.prior.generator import StrandGenerator
from neural_strands.prior.traversal import measure, traverse


class LengthOfLatentOne(StrandGenerator):
    """A generator whose second latent is the logarithm of the length, and whose third moves strands a little."""

    def forward(self, latent: Tensor, points: int = 100) -> Tensor:
        t = torch.linspace(0, 1, points)
        straight = torch.stack([0 * t, 0.01 * t * t, 0.1 * t], dim=-1)
        shift = 0.001 * latent[:, 2, None, None] * t[:, None]
        return straight * latent[:, 1, None, None].exp() + shift


def test_the_direction_of_length_is_found(generator: torch.Generator) -> None:
    net = LengthOfLatentOne()
    nn.init.zeros_(net.linear.bias)
    result = traverse(net, 0.3 * torch.randn(2000, 64, generator=generator))
    assert result.correlation[1, 0] == pytest.approx(1, abs=0.01)
    assert result.direction[0].abs().argmax() == 1
    assert result.direction_correlation[0] > 0.99
    assert result.effect_mm.argsort(descending=True)[:2].tolist() == [1, 2]
    # Latent 2 shifts the point at t by t sqrt(3) mm.
    assert float(result.effect_mm[2]) == pytest.approx(3**0.5 / 2, rel=0.01)
    assert (result.effect_mm[3:] == 0).all()


def test_measures_tell_coils_from_bends() -> None:
    t = torch.linspace(0, 1, 100)
    straight = torch.stack([0 * t, 0 * t, 0.2 * t], dim=-1)
    coil = straight + 0.005 * torch.stack([(60 * t).cos() - 1, (60 * t).sin(), 0 * t], dim=-1)
    arc = 0.1 * torch.stack([(2 * t).sin(), 0 * t, 1 - (2 * t).cos()], dim=-1)
    values = measure(torch.stack([straight, coil, arc]))
    assert values[1, 1] > values[[0, 2], 1].max() + 2
    assert values[2, 2] > values[[0, 1], 2].max() + 2
    torch.testing.assert_close(values[0, 0], torch.tensor(0.2).log())


def test_measures_are_finite_for_all_curves() -> None:
    assert torch.isfinite(measure(synthetic_curves(200, torch.Generator().manual_seed(0), CurveConfig()))).all()
