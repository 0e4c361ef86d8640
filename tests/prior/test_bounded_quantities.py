"""Bounded quantities: their inverses, and lengths beyond those of training."""

import math

import pytest
import torch

from neural_strands.prior.bounded_quantities import (
    LONGEST,
    LONGEST_TRAINED,
    SHORTEST,
    TAIL_SLOPE,
    TAIL_START,
    length_from_raw,
    logit_between,
    quantity_between,
    raw_from_length,
)
from neural_strands.prior.curves import CurveConfig


def test_between_and_its_inverse() -> None:
    value = torch.tensor([0.01, 0.1, 0.6])
    torch.testing.assert_close(quantity_between(logit_between(value, 0.003, 2.0), 0.003, 2.0), value)
    # Half way is the geometric mean.
    torch.testing.assert_close(quantity_between(torch.zeros(1), 0.01, 1.0), torch.tensor([0.1]))


def test_lengths_of_training_are_the_plain_ones() -> None:
    assert CurveConfig().longest == LONGEST_TRAINED
    length = torch.linspace(CurveConfig().shortest, LONGEST_TRAINED, 500)
    raw = logit_between(length, SHORTEST, LONGEST)
    assert raw.abs().max() == pytest.approx(TAIL_START, rel=1e-5)
    inside = raw.abs() <= TAIL_START
    assert torch.equal(raw_from_length(length)[inside], raw[inside])
    assert torch.equal(length_from_raw(raw)[inside], quantity_between(raw, SHORTEST, LONGEST)[inside])
    torch.testing.assert_close(length_from_raw(raw), length, rtol=1e-5, atol=0)


def test_every_length_has_a_raw_number_and_back() -> None:
    length = torch.logspace(-2.4, 0.25, 1000, dtype=torch.float64)
    raw = raw_from_length(length)
    assert (raw.diff() > 0).all()
    torch.testing.assert_close(length_from_raw(raw), length, rtol=1e-9, atol=0)


def test_lengths_beyond_training_follow_ever_more_slowly_and_without_a_kink() -> None:
    raw = torch.linspace(-40, 40, 80_001, dtype=torch.float64, requires_grad=True)
    length = length_from_raw(raw)
    assert float(length.detach().min()) > SHORTEST
    assert float(length.detach().max()) < LONGEST
    logit = torch.logit((length / SHORTEST).log() / math.log(LONGEST / SHORTEST))
    (slope,) = torch.autograd.grad(logit.sum(), raw)
    assert torch.isfinite(slope).all()
    # A kink would be a jump from 1 to a quarter.
    assert float(slope.diff().abs().max()) < 0.03
    outside = raw.detach().abs() > TAIL_START
    torch.testing.assert_close(slope[~outside], torch.ones_like(slope[~outside]))
    assert float(slope[0]) == pytest.approx(1 / TAIL_SLOPE, rel=0.02)
    # A metre, which was at 2.1 deviations of a standard normal number, is beyond 3.
    assert float(raw_from_length(torch.tensor([1.0]))) > 3.0
