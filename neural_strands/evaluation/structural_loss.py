"""The image loss that replaces LPIPS when its weights are not available."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.evaluation.image_metrics import WINDOW, masked_mean, ssim_map

SCALES = 4
"""Largest number of octaves compared: full resolution and successive halvings, as long as SSIM's window fits."""
GRADIENT_WEIGHT = 1.0
"""Weight of the difference of finite differences, relative to 1 - SSIM."""


def structural_loss(
    image: Float[Tensor, "*batch height width channel"],
    reference: Float[Tensor, "*batch height width channel"],
    mask: Float[Tensor, "*batch height width"] | None = None,
) -> Float[Tensor, "*batch"]:
    """Multi-scale structural loss: at each octave 1 - SSIM plus the absolute difference of image gradients, averaged.

    SSIM compares local means, contrast and structure; the gradients preserve thin bright and dark strands, which a
    pixel loss would average out. Zero for equal images, about 1 for unrelated ones. Octaves are 2 x 2 means.

    Args:
        image: sRGB in [0, 1].
        reference: sRGB in [0, 1].
        mask: weight of each pixel, for instance coverage of hair; by default all weights are equal.

    Raises:
        ValueError: the image is smaller than SSIM's window.
    """
    total = image.new_zeros(image.shape[:-3])
    margin = WINDOW // 2
    octaves = 0
    while octaves < SCALES and (octaves == 0 or min(image.shape[-3:-1]) >= WINDOW):
        inner = None if mask is None else mask[..., margin:-margin, margin:-margin]
        total = total + _weighted(1 - ssim_map(image, reference), inner)
        total = total + GRADIENT_WEIGHT * _gradient_difference(image - reference, mask)
        image, reference = _halved(image), _halved(reference)
        mask = None if mask is None else _halved(mask[..., None])[..., 0]
        octaves += 1
    return total / octaves


def _gradient_difference(
    difference: Float[Tensor, "*batch height width channel"], mask: Float[Tensor, "*batch height width"] | None
) -> Float[Tensor, "*batch"]:
    """Mean absolute forward difference along rows and columns, of the difference of two images."""
    down = (difference[..., 1:, :, :] - difference[..., :-1, :, :]).abs().mean(dim=-1)
    across = (difference[..., :, 1:, :] - difference[..., :, :-1, :]).abs().mean(dim=-1)
    if mask is None:
        return down.mean(dim=(-2, -1)) + across.mean(dim=(-2, -1))
    return _weighted(down, mask[..., 1:, :]) + _weighted(across, mask[..., :, 1:])


def _weighted(
    values: Float[Tensor, "*batch height width"], mask: Float[Tensor, "*batch height width"] | None
) -> Float[Tensor, "*batch"]:
    """Masked mean that is 0, not NaN, for an empty mask: a crop without hair costs nothing."""
    if mask is None:
        return masked_mean(values, None)
    total = mask.sum(dim=(-2, -1))
    return (values * mask).sum(dim=(-2, -1)) / torch.where(total > 0, total, 1.0)


def _halved(image: Float[Tensor, "*batch height width channel"]) -> Float[Tensor, "*batch half half_width channel"]:
    """Means of 2 x 2 pixels; an odd last row or column is left out."""
    planes = image.movedim(-1, -3)
    flat = torch.nn.functional.avg_pool2d(planes.reshape(-1, 1, *planes.shape[-2:]), 2)
    return flat.reshape(*planes.shape[:-2], *flat.shape[-2:]).movedim(-3, -1)
