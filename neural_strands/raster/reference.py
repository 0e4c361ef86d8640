"""Plain torch twins of the kernels: slow, short, and what the kernels are held to."""

import torch
from jaxtyping import Float
from torch import Tensor


def splat_reference(
    pixels: Float[Tensor, "point 2"],
    features: Float[Tensor, "point channel"],
    size: tuple[int, int],
    scale: float,
    minimum_weight: float,
) -> tuple[Float[Tensor, "cell channel"], Float[Tensor, " cell"]]:
    """One level of the splat: weighted means and sums of weights of every pixel, row after row; differentiable.

    Args:
        pixels: x and y in pixels of the full image.
        features: what each point carries.
        size: height and width of this level.
        scale: pixels of this level to one pixel of the full image.
        minimum_weight: least divisor of the weighted mean.
    """
    height, width = size
    sums = features.new_zeros(height * width, features.shape[1])
    weights = features.new_zeros(height * width)
    position = pixels * scale - 0.5
    corner = position.detach().floor()
    fraction = position - corner
    for down in (0, 1):
        for right in (0, 1):
            u, v = (corner[:, 0] + right).long(), (corner[:, 1] + down).long()
            weight_x = fraction[:, 0] if right else 1 - fraction[:, 0]
            weight_y = fraction[:, 1] if down else 1 - fraction[:, 1]
            inside = torch.nonzero((u >= 0) & (u < width) & (v >= 0) & (v < height)).squeeze(1)
            cell, weight = (v * width + u)[inside], (weight_x * weight_y)[inside]
            weights = weights.index_add(0, cell, weight)
            sums = sums.index_add(0, cell, weight[:, None] * features[inside])
    return sums / weights.clamp(min=minimum_weight)[:, None], weights
