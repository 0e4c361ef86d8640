"""Maps unbounded numbers to bounded positive quantities: the length of a strand, the frequency of its curl."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

SHORTEST, LONGEST = 0.003, 2.0
"""Shortest and longest strand that the generator can produce, metres."""
LONGEST_TRAINED = 0.60
"""Longest strand of the training curves, metres. The shortest one has the negative of its logit."""
TAIL_START = math.log(math.log(LONGEST_TRAINED / SHORTEST) / math.log(LONGEST / LONGEST_TRAINED))
"""Logit of the longest trained length, between the bounds."""
TAIL_SLOPE = 4.0
"""Factor by which raw numbers are spread out for lengths far beyond training."""
TAIL_BEND = 0.3
"""Range of logits beyond `TAIL_START` over which the slope rises to `TAIL_SLOPE`."""


def quantity_between(logit: Float[Tensor, " strand"], low: float, high: float) -> Float[Tensor, " strand"]:
    """Map a logit to a positive quantity between two bounds, evenly in its logarithm."""
    return low * (high / low) ** logit.sigmoid()


def logit_between(value: Float[Tensor, " strand"], low: float, high: float) -> Float[Tensor, " strand"]:
    """Inverse of `quantity_between`; values outside the bounds are clamped to them."""
    share = (value / low).log() / torch.full_like(value, high / low).log()
    return torch.logit(share, eps=1e-4)


def length_from_raw(raw: Float[Tensor, " strand"]) -> Float[Tensor, " strand"]:
    """Length in metres from a raw number.

    It equals `quantity_between` for the lengths seen in training. Beyond them, length grows ever more slowly, so that
    few samples of a normal distribution over raw numbers reach a metre, while every length still has a raw number.
    """
    beyond = (raw.abs() - TAIL_START).clamp(min=0)
    # Positive root of the quadratic equation that inverts raw_from_length, in a form that is exact at 0.
    low = beyond - TAIL_BEND
    root = (low.square() + 4 * TAIL_SLOPE * TAIL_BEND * beyond).sqrt()
    slowed = 2 * TAIL_BEND * beyond / (root - low)
    return quantity_between(raw.clamp(-TAIL_START, TAIL_START) + raw.sign() * slowed, SHORTEST, LONGEST)


def raw_from_length(length: Float[Tensor, " strand"]) -> Float[Tensor, " strand"]:
    """Inverse of `length_from_raw`; lengths outside the bounds are clamped to them."""
    logit = logit_between(length, SHORTEST, LONGEST)
    beyond = (logit.abs() - TAIL_START).clamp(min=0)
    return logit + logit.sign() * (TAIL_SLOPE - 1) * beyond.square() / (beyond + TAIL_BEND)
