"""Ends strands early without changing their number of points."""

import torch
from jaxtyping import Float
from torch import Tensor


def shorten(points: Float[Tensor, "strand point 3"], last: Float[Tensor, " strand"]) -> Float[Tensor, "strand point 3"]:
    """End strands at a (fractional) point index; the same number of points is spaced evenly up to it."""
    count = points.shape[1]
    position = last[:, None] * torch.linspace(0.0, 1.0, count, device=points.device)
    left = position.floor().long().clamp(max=count - 2)
    weight = (position - left)[..., None]
    picked = [points.gather(1, index[..., None].expand(-1, -1, 3)) for index in (left, left + 1)]
    return picked[0] * (1 - weight) + picked[1] * weight
