"""Lengths of strands against true ones: straight strands whose quantiles are known in closed form."""

import pytest
import torch

from neural_strands.evaluation.strand_lengths import ROOTED, compare_lengths


def straight(long: torch.Tensor, aside: float = 0.0, points: int = 8) -> torch.Tensor:
    """Hanging strands of these lengths, 20 mm apart, all moved sideways by so many metres."""
    strands = torch.zeros(len(long), points, 3)
    strands[..., 0] = 0.02 * torch.arange(len(long))[:, None]
    strands[..., 1] = -long[:, None] * torch.linspace(0, 1, points)
    strands[..., 2] = aside
    return strands


def test_quantiles_of_evenly_spaced_lengths():
    """Lengths from 50 to 250 mm in equal steps: the median is 150 mm, the 95th percentile 50 + 0.95 * 200 = 240 mm."""
    truth = straight(torch.linspace(0.05, 0.25, 41))
    # Half as long and 20 mm more: 45 to 145 mm, with fewer points; median 95 mm, 95th percentile 140 mm.
    found = straight(0.02 + 0.5 * torch.linspace(0.05, 0.25, 41), aside=0.9 * ROOTED, points=3)
    agreement = compare_lengths(found, truth)
    assert agreement is not None
    expected = {
        "compared": 41,
        "median_m": 0.095,
        "true_median_m": 0.150,
        "median_ratio": 95 / 150,
        "95_m": 0.140,
        "true_95_m": 0.240,
        "95_ratio": 140 / 240,
    }
    assert agreement.as_dict() == pytest.approx(expected, rel=1e-5)
    assert agreement.as_text() == (
        "median 95.0 mm, 0.63 times the true 150.0 mm; 95th percentile 140.0 mm, 0.58 times the true 240.0 mm"
    )


def test_strands_that_grow_where_no_true_one_does_are_left_out():
    truth = straight(torch.full((5,), 0.1))
    beside, apart = straight(torch.full((3,), 0.2)), straight(torch.full((5,), 0.9), aside=1.1 * ROOTED)
    agreement = compare_lengths(torch.cat([apart, beside]), truth)
    assert agreement is not None
    assert agreement.compared == 3
    assert agreement.ratios == pytest.approx((2.0, 2.0))
    assert compare_lengths(apart, truth) is None
    assert compare_lengths(truth[:0], truth) is None


def test_true_strands_without_length_are_no_ruler():
    truth = straight(torch.zeros(5))
    assert compare_lengths(truth, truth) is None
