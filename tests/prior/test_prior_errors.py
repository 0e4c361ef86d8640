"""Errors against closed forms."""

import math

import pytest
import torch

from neural_strands.prior.errors import angles, curvatures, percentile, reconstruction_error, strand_errors


def circle(radius: float, points: int = 100) -> torch.Tensor:
    angle = torch.linspace(0, 3, points, dtype=torch.float64)
    return radius * torch.stack([angle.cos(), angle.sin(), 0 * angle], dim=-1)[None]


def test_a_shifted_strand_errs_by_the_shift_alone() -> None:
    error = reconstruction_error(circle(0.05) + torch.tensor([0.003, 0.004, 0.0]), circle(0.05))
    assert error.mean_mm == pytest.approx(5)
    assert error.median_mm == pytest.approx(5)
    assert error.p95_mm == pytest.approx(5)
    assert error.direction_deg == pytest.approx(0, abs=1e-5)
    assert error.length_percent == pytest.approx(0, abs=1e-5)
    assert error.strands == 1


def test_a_turned_straight_strand_errs_by_the_angle() -> None:
    straight = torch.linspace(0, 1, 50, dtype=torch.float64)[:, None] * torch.tensor([[1.0, 0.0, 0.0]])
    turned = straight[:, :1] * torch.tensor([[math.cos(0.1), math.sin(0.1), 0.0]])
    assert reconstruction_error(turned[None], straight[None]).direction_deg == pytest.approx(math.degrees(0.1))


def test_curvature_of_a_circle_is_one_over_its_radius() -> None:
    torch.testing.assert_close(
        curvatures(circle(0.05)), torch.full((1, 98), 20.0, dtype=torch.float64), rtol=1e-3, atol=0
    )
    error = reconstruction_error(circle(0.04), circle(0.05))
    assert error.curvature_per_m == pytest.approx(5, rel=1e-3)
    assert error.length_percent == pytest.approx(20, rel=1e-3)


def test_small_angles_are_exact() -> None:
    first = torch.tensor([[1.0, 0.0, 0.0]])
    torch.testing.assert_close(angles(first, torch.tensor([[1.0, 1e-5, 0.0]])), torch.tensor([1e-5]))


def test_percentile_and_strand_errors() -> None:
    assert percentile(torch.arange(1, 101).double(), 0.95) == 95
    assert percentile(torch.zeros(0), 0.95) == 0
    true = torch.zeros(2, 4, 3)
    torch.testing.assert_close(strand_errors(true + torch.tensor([0.001, 0.0, 0.0]), true), torch.ones(2))
