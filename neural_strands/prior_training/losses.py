"""Losses of the strand prior (paper, "Training / Strand Generator")."""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.analysis import DIRECTION_WEIGHT

LIKE_SQUARED = 0.005
"""Distance at which `absolute_loss` and `paper_loss` agree, metres."""


def paper_loss(
    decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"], direction_weight: float
) -> Float[Tensor, ""]:
    """Data term of the paper: sum over points of the squared distance (metres) and of 1 - cosine, mean over strands."""
    squared = (decoded - true).square().sum(dim=(1, 2))
    return (squared + direction_weight * _unlike_directions(decoded, true)).mean()


def absolute_loss(
    decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"], direction_weight: float
) -> Float[Tensor, ""]:
    """The paper's data term with distances that are not squared (L1): outliers count less.

    Distances are multiplied by `LIKE_SQUARED`, so that the same weights can be used as in `paper_loss`.
    """
    distance = LIKE_SQUARED * (decoded - true).norm(dim=-1).sum(dim=1)
    return (distance + direction_weight * _unlike_directions(decoded, true)).mean()


def turn_loss(decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"]) -> Float[Tensor, ""]:
    """Squared error of the turn from each segment to the next (unit directions' difference), summed, mean over strands.

    It penalises a strand that follows the axis of a coil, which fits the positions alone as well as the curl does.
    """
    turn, true_turn = (torch.diff(unit_directions(points), dim=1) for points in (decoded, true))
    return (turn - true_turn).square().sum(dim=(1, 2)).mean()


def unit_directions(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point-1 3"]:
    """Unit direction of each segment; zero for one of no length."""
    return torch.nn.functional.normalize(segments(points), dim=-1, eps=1e-12)


def _unlike_directions(
    decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"]
) -> Float[Tensor, " strand"]:
    """Sum of 1 - cosine over the segments of each strand."""
    cosine = torch.nn.functional.cosine_similarity(segments(decoded), segments(true), dim=-1, eps=1e-12)
    return (1 - cosine).sum(dim=1)


def relative_loss(decoded: Float[Tensor, "strand point 3"], true: Float[Tensor, "strand point 3"]) -> Float[Tensor, ""]:
    """Root mean square error of positions and slopes in strand lengths (the error of the analysis), mean over strands.

    The root makes it robust (an L1 norm over strands); the division lets short hair count as much as long hair.
    """
    error = (decoded - true) / lengths(true)[:, None, None]
    slope = segments(error) * (true.shape[1] - 1)
    squared = error.square().sum(dim=(1, 2)) + DIRECTION_WEIGHT**2 * slope.square().sum(dim=(1, 2))
    return (squared / true.shape[1] + 1e-12).sqrt().mean()


def kl_divergence(
    mean: Float[Tensor, "strand latent"], log_std: Float[Tensor, "strand latent"], free_bits: float = 0.0
) -> Float[Tensor, ""]:
    """KL divergence of N(mean, std) from N(0, I), mean over strands, at least `free_bits` per latent, summed."""
    each = 0.5 * (mean.square() + (2 * log_std).exp() - 1) - log_std
    return each.mean(dim=0).clamp(min=free_bits).sum()


def gaussian_likelihood(
    latent: Float[Tensor, "strand latent"], log_volume: Float[Tensor, " strand"]
) -> Float[Tensor, ""]:
    """Negative log likelihood of invertible latents under N(0, I), nats per latent (up to the linear map's constant).

    The KL term tends to this as the posterior narrows to its mean.
    """
    total = 0.5 * (latent.square() + math.log(2 * math.pi)).sum(dim=1) - log_volume
    return total.mean() / latent.shape[1]
