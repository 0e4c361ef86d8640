"""Losses of the prior against closed forms."""

import math

import pytest
import torch

from neural_strands.prior_training.losses import (
    absolute_loss,
    gaussian_likelihood,
    kl_divergence,
    paper_loss,
    relative_loss,
    turn_loss,
)


def straight(length: float) -> torch.Tensor:
    return torch.linspace(0, length, 100)[:, None].expand(2, 100, 1) * torch.tensor([0.0, 0.0, 1.0])


def test_paper_loss_of_a_shift_and_of_a_turn() -> None:
    true = straight(0.1)
    shifted = true + torch.tensor([0.003, 0.0, 0.0])
    # 100 points, each 3 mm off; directions agree.
    assert float(paper_loss(shifted, true, 1e-3)) == pytest.approx(100 * 9e-6, rel=1e-4)
    turned = straight(0.1)[..., [2, 1, 0]]
    squared = 2 * true[0, :, 2].square().sum()
    # 99 segments at a right angle: 1 - cosine is 1 each.
    assert float(paper_loss(turned, true, 1e-3)) == pytest.approx(float(squared) + 99e-3, rel=1e-4)


def test_absolute_loss_grows_with_the_distance_and_meets_the_papers_at_5_mm() -> None:
    true = straight(0.1)
    at_5 = true + torch.tensor([0.005, 0.0, 0.0])
    torch.testing.assert_close(absolute_loss(at_5, true, 1e-3), paper_loss(at_5, true, 1e-3))
    at_10 = true + torch.tensor([0.0, 0.01, 0.0])
    torch.testing.assert_close(absolute_loss(at_10, true, 1e-3), 2 * absolute_loss(at_5, true, 1e-3))
    turned = straight(0.1)[..., [2, 1, 0]]
    distance = 0.005 * math.sqrt(2) * true[0, :, 2].sum()
    assert float(absolute_loss(turned, true, 1e-3)) == pytest.approx(float(distance) + 99e-3, rel=1e-4)


def test_absolute_loss_has_a_gradient_where_points_agree() -> None:
    # The roots always do: both lie at 0.
    decoded = straight(0.1).requires_grad_(True)
    absolute_loss(decoded, straight(0.1), 1e-3).backward()
    assert decoded.grad is not None
    assert torch.isfinite(decoded.grad).all()


def test_turn_loss_counts_turns_alone() -> None:
    true = straight(0.1)
    turned = straight(0.2)[..., [2, 1, 0]]
    # Straight strands do not turn, whatever their place, scale and heading.
    assert float(turn_loss(turned, true)) == pytest.approx(0, abs=1e-9)
    corner = true.clone()
    corner[:, 50:, 0] = true[:, 50:, 2] - true[0, 49, 2]
    corner[:, 50:, 2] = true[:, 49:50, 2]
    # One right angle: directions differ by the diagonal of a unit square.
    assert float(turn_loss(corner, true)) == pytest.approx(2.0, rel=1e-5)


def test_relative_loss_does_not_depend_on_scale() -> None:
    generator = torch.Generator().manual_seed(0)
    true = torch.rand(4, 100, 3, generator=generator).cumsum(dim=1)
    decoded = true + 0.1 * torch.rand(4, 100, 3, generator=generator)
    torch.testing.assert_close(relative_loss(0.01 * decoded, 0.01 * true), relative_loss(decoded, true))
    # A shift by a hundredth of the length has no slope.
    true = straight(0.2)
    assert float(relative_loss(true + torch.tensor([0.002, 0.0, 0.0]), true)) == pytest.approx(0.01, rel=1e-3)


def test_kl_divergence_agrees_with_torch() -> None:
    generator = torch.Generator().manual_seed(0)
    mean, log_std = torch.randn(30, 8, generator=generator), torch.randn(30, 8, generator=generator)
    normal = torch.distributions.Normal
    expected = torch.distributions.kl_divergence(normal(mean, log_std.exp()), normal(0.0, 1.0))
    torch.testing.assert_close(kl_divergence(mean, log_std), expected.mean(dim=0).sum())
    assert float(kl_divergence(torch.zeros(5, 8), torch.zeros(5, 8), free_bits=0.25)) == pytest.approx(2.0)


def test_gaussian_likelihood_is_the_density_of_a_change_of_variables() -> None:
    # x = 3 z: z = x / 3 has log volume -2 log 3 in two dimensions.
    value = torch.tensor([[1.0, -2.0], [0.5, 4.0]])
    normal = torch.distributions.Normal(0.0, 3.0)
    found = gaussian_likelihood(value / 3, torch.full((2,), -2 * math.log(3)))
    torch.testing.assert_close(found, -normal.log_prob(value).mean())
