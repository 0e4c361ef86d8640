"""Smoothstep, against the conditions that define it."""

import pytest
import torch

from neural_strands.foundation.smoothstep import smoothstep


def test_it_is_the_cubic_that_is_level_at_both_ends():
    # Of all cubics, value and slope at both ends determine one: solve for its coefficients.
    ends = torch.tensor([[0, 0, 0, 1], [1, 1, 1, 1], [0, 0, 1, 0], [3, 2, 1, 0]], dtype=torch.float64)
    cubic = torch.linalg.solve(ends, torch.tensor([0, 1, 0, 0], dtype=torch.float64))
    share = torch.linspace(0, 1, 101, dtype=torch.float64)
    expected = torch.stack([share**3, share**2, share, torch.ones_like(share)], dim=1) @ cubic
    torch.testing.assert_close(smoothstep(share), expected)


@pytest.mark.parametrize(("share", "value"), [(-5.0, 0.0), (0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (7.0, 1.0)])
def test_it_is_constant_beyond_the_ends_for_numbers_and_tensors(share, value):
    assert smoothstep(share) == value
    assert smoothstep(torch.tensor(share)).item() == value
