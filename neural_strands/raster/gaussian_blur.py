"""A Gaussian blur of pictures."""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional


def gaussian_blur(image: Float[Tensor, "*batch height width"], sigma: float) -> Float[Tensor, "*batch height width"]:
    """Blur with a Gaussian of standard deviation `sigma` pixels, repeating the border."""
    radius = math.ceil(3 * sigma)
    if radius == 0:
        return image
    steps = torch.arange(-radius, radius + 1, dtype=torch.float64)
    kernel = torch.exp(-0.5 * (steps / sigma) ** 2)
    weights = (kernel / kernel.sum()).tolist()
    height, width = image.shape[-2:]
    flat = image.reshape(-1, 1, height, width)
    padded = functional.pad(flat, (radius, radius, radius, radius), mode="replicate")
    # Shifted images are summed because torch's CPU convolution of one channel is several times slower.
    rows = padded[..., :width] * weights[0]
    for shift, weight in enumerate(weights[1:], start=1):
        rows.add_(padded[..., shift : shift + width], alpha=weight)
    blurred = rows[..., :height, :] * weights[0]
    for shift, weight in enumerate(weights[1:], start=1):
        blurred.add_(rows[..., shift : shift + height, :], alpha=weight)
    return blurred.view(image.shape)
