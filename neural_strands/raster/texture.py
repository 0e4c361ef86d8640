"""Texture sampling whose backward pass blurs the gradient into the texture (paper, "Training", gradient blurring).

Textures are height x width x channel, so that the texels of one root lie together. Texel centres are at +0.5 and the
border is clamped: column = u * width - 0.5, row = v * height - 0.5. Row 0 is where v = 0, so v grows with the row.
"""

import functools
import math
from typing import Any

import scipy.special
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.foundation.devices.transfers import sent

NEGLIGIBLE = 1e-6
"""Frequencies that the blur attenuates to less than this are left out, and so are the outermost taps of this sum."""

BAND = 32
"""Rows of a blur matrix that are multiplied together; they share the few columns that are not zero."""


def sample_texture(
    texture: Float[Tensor, "height width channel"], uv: Float[Tensor, "point 2"], blur: float = 0.0
) -> Float[Tensor, "point channel"]:
    """Sample a texture bilinearly.

    Args:
        texture: texels; their gradient is blurred, the samples are not.
        uv: where to sample, in [0, 1]; the border is repeated beyond it.
        blur: standard deviation, in texels, of the Gaussian that blurs the gradient; 0 leaves it unchanged.
    """
    return sample_bilinear(texture if blur <= 0 else blur_gradient(texture, blur), uv)


def sample_bilinear(
    texture: Float[Tensor, "height width channel"], uv: Float[Tensor, "point 2"]
) -> Float[Tensor, "point channel"]:
    """Sample a texture bilinearly, with plain gradients to texels and uv."""
    height, width, channels = texture.shape
    x = (uv[:, 0] * width - 0.5).clamp(0, width - 1)
    y = (uv[:, 1] * height - 0.5).clamp(0, height - 1)
    left, top = x.detach().floor().long(), y.detach().floor().long()
    right, bottom = (left + 1).clamp(max=width - 1), (top + 1).clamp(max=height - 1)
    index = torch.cat([top * width + left, top * width + right, bottom * width + left, bottom * width + right])
    corners = texture.reshape(-1, channels).index_select(0, index).view(4, -1, channels)
    across, down = (x - left)[:, None], (y - top)[:, None]
    upper = torch.lerp(corners[0], corners[1], across)
    lower = torch.lerp(corners[2], corners[3], across)
    return torch.lerp(upper, lower, down)


def sample_picture(
    texture: Float[Tensor, "height width channel"], uv: Float[Tensor, "point 2"]
) -> Float[Tensor, "point channel"]:
    """The same as `sample_bilinear`, up to rounding, but much faster for many points and few channels."""
    read = functional.grid_sample(
        texture.permute(2, 0, 1)[None],
        (2 * uv - 1)[None, None],
        mode="bilinear",
        padding_mode="border",
        align_corners=False,
    )
    return read[0, :, 0].T


def blur_gradient(
    texture: Float[Tensor, "height width channel"], sigma: float
) -> Float[Tensor, "height width channel"]:
    """Return the texture unchanged; its gradient is blurred by a Gaussian of `sigma` texels in the backward pass."""
    return _BlurGradient.apply(texture, sigma)


def blur_texture(image: Float[Tensor, "height width channel"], sigma: float) -> Float[Tensor, "height width channel"]:
    """Blur by a Gaussian of `sigma` texels, mirrored at the border; the sum of all texels is preserved."""
    height, width, _ = image.shape
    for axis, count in ((0, height), (1, width)):
        factors = _blur_factors(count, sigma, image.dtype, image.device)
        if len(factors) == 1:
            image = _along_band(factors[0], image, axis, _reach(sigma))
        else:
            for factor in factors:
                image = _along(factor, image, axis)
    return image


class _BlurGradient(torch.autograd.Function):
    """Identity forward, Gaussian blur backward."""

    @staticmethod
    def forward(ctx: Any, texture: Tensor, sigma: float) -> Tensor:
        ctx.sigma = sigma
        return texture.view_as(texture)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return blur_texture(gradients[0], ctx.sigma), None


@functools.lru_cache(maxsize=64)
def _blur_factors(count: int, sigma: float, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, ...]:
    """Matrices whose product blurs a signal of `count` samples.

    The blur is the discrete Gaussian (Lindeberg 1990): taps exp(-sigma^2) I_n(sigma^2), positive and of variance
    sigma^2 at every width. With mirrored ends its eigenvectors are cosines (DCT-II), with eigenvalues exp(sigma^2 (cos
    omega - 1)). A wide blur keeps few of these, so it is a product of two thin matrices; a narrow one is a single
    square matrix.
    """
    frequency = math.pi * torch.arange(count, dtype=torch.float64) / count
    gain = torch.exp(sigma**2 * (torch.cos(frequency) - 1))
    kept = int((gain > NEGLIGIBLE).sum())
    # The fit's coarse-to-fine schedule changes sigma at every step, so caching the matrices would not help.
    frequency, gain = sent(torch.stack([frequency[:kept], gain[:kept]]), device).unbind(0)
    phase = frequency[:, None] * (torch.arange(count, dtype=torch.float64, device=device) + 0.5)
    cosines = torch.cos(phase) * math.sqrt(2.0 / count)
    cosines[0] /= math.sqrt(2.0)
    weighted = cosines.T * gain
    factors = (weighted @ cosines,) if 2 * kept >= count else (cosines, weighted)
    return tuple(factor.to(dtype) for factor in factors)


def _reach(sigma: float) -> int:
    """Number of texels on each side beyond which the discrete Gaussian has less than `NEGLIGIBLE` of its sum."""
    reach, outside = 0, 1.0 - scipy.special.ive(0, sigma**2)
    while outside > NEGLIGIBLE:
        reach += 1
        outside -= 2.0 * scipy.special.ive(reach, sigma**2)
    return reach


def _along_band(
    matrix: Float[Tensor, "out in"], image: Float[Tensor, "h w channel"], axis: int, reach: int
) -> Float[Tensor, "..."]:
    """Multiply by a square matrix that is negligible farther than `reach` from its diagonal."""
    parts = []
    for first in range(0, len(matrix), BAND):
        last = min(first + BAND, len(matrix))
        low, high = max(first - reach, 0), min(last + reach, len(matrix))
        parts.append(_along(matrix[first:last, low:high], image.narrow(axis, low, high - low), axis))
    return torch.cat(parts, dim=axis)


def _along(matrix: Float[Tensor, "out in"], image: Float[Tensor, "h w channel"], axis: int) -> Float[Tensor, "..."]:
    """Multiply the rows (axis 0) or columns (axis 1) of an image by a matrix."""
    height, width, channels = image.shape
    if axis == 0:
        return (matrix @ image.reshape(height, width * channels)).view(-1, width, channels)
    return torch.matmul(matrix, image)
