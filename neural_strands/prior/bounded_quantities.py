"""Bounded positive quantities from unbounded numbers: the length of a strand, the frequency of its curl."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

SHORTEST, LONGEST = 0.003, 2.0
"""Strand lengths (metres) that the generator reaches."""
LONGEST_TRAINED = 0.60
"""Longest strand of the training curves, metres; the shortest's logit between the bounds is the opposite number."""
TAIL_START = math.log(math.log(LONGEST_TRAINED / SHORTEST) / math.log(LONGEST / LONGEST_TRAINED))
"""Logit of the longest trained length between the bounds."""
TAIL_SLOPE = 4.0
"""How many times farther apart lengths lie in raw numbers far beyond those of training."""
TAIL_BEND = 0.3
"""Logits beyond `TAIL_START` over which that sets in."""


def between(logit: Float[Tensor, " strand"], low: float, high: float) -> Float[Tensor, " strand"]:
    """Squash a logit to a positive quantity between two bounds, even in its logarithm."""
    return low * (high / low) ** logit.sigmoid()


def logit_between(value: Float[Tensor, " strand"], low: float, high: float) -> Float[Tensor, " strand"]:
    """Inverse of `between`; values outside are taken at the bound."""
    share = (value / low).log() / torch.full_like(value, high / low).log()
    return torch.logit(share, eps=1e-4)


def length_from_raw(raw: Float[Tensor, " strand"]) -> Float[Tensor, " strand"]:
    """Length in metres of a raw number.

    It is `between` at the lengths of training; beyond, lengths follow ever more slowly, so that the tails of a normal
    distribution over the raw numbers hold few strands of a metre, and yet every length has a raw number.
    """
    beyond = (raw.abs() - TAIL_START).clamp(min=0)
    # The positive root of the square equation that raw_from_length's hyperbola makes, in a form exact at 0.
    low = beyond - TAIL_BEND
    root = (low.square() + 4 * TAIL_SLOPE * TAIL_BEND * beyond).sqrt()
    slowed = 2 * TAIL_BEND * beyond / (root - low)
    return between(raw.clamp(-TAIL_START, TAIL_START) + raw.sign() * slowed, SHORTEST, LONGEST)


def raw_from_length(length: Float[Tensor, " strand"]) -> Float[Tensor, " strand"]:
    """Inverse of `length_from_raw`; lengths outside the bounds are taken at the bound."""
    logit = logit_between(length, SHORTEST, LONGEST)
    beyond = (logit.abs() - TAIL_START).clamp(min=0)
    return logit + logit.sign() * (TAIL_SLOPE - 1) * beyond.square() / (beyond + TAIL_BEND)
