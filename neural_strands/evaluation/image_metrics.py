"""PSNR and SSIM of images in [0, 1], over the whole image or within a mask (the hair region); differentiable."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.precision import exact_convolutions
from neural_strands.raster.fir import Filter, filtered

WINDOW = 11
"""Width of SSIM's Gaussian window, pixels (Wang et al. 2004)."""
SIGMA = 1.5
"""Standard deviation of SSIM's Gaussian window, pixels."""
LUMINANCE_CONSTANT = 0.01**2
"""SSIM's C1 for a range of values of 1."""
CONTRAST_CONSTANT = 0.03**2
"""SSIM's C2 for a range of values of 1."""


def psnr(
    image: Float[Tensor, "*batch height width channel"],
    reference: Float[Tensor, "*batch height width channel"],
    mask: Float[Tensor, "*batch height width"] | None = None,
) -> Float[Tensor, "*batch"]:
    """Peak signal-to-noise ratio in dB, 10 log10(1 / mean squared error); infinite for equal images.

    A mask weights the squared error of each pixel; an empty one gives NaN.
    """
    error = (image - reference).square().mean(dim=-1)
    return -10 * torch.log10(masked_mean(error, mask))


def ssim(
    image: Float[Tensor, "*batch height width channel"],
    reference: Float[Tensor, "*batch height width channel"],
    mask: Float[Tensor, "*batch height width"] | None = None,
) -> Float[Tensor, "*batch"]:
    """Structural similarity: Gaussian window of 11 pixels, sigma 1.5, mean over channels and window positions.

    Only windows that lie entirely in the image count; a mask weights them by its value at their centres.

    Raises:
        ValueError: the image is smaller than the window.
    """
    similarity = ssim_map(image, reference)
    margin = WINDOW // 2
    inner = None if mask is None else mask[..., margin:-margin, margin:-margin]
    return masked_mean(similarity, inner)


def ssim_map(
    image: Float[Tensor, "*batch height width channel"], reference: Float[Tensor, "*batch height width channel"]
) -> Float[Tensor, "*batch inner_height inner_width"]:
    """SSIM of each window that lies entirely in the image (5 pixels fewer at each border), mean over channels.

    Raises:
        ValueError: the image is smaller than the window.
    """
    if min(image.shape[-3:-1]) < WINDOW:
        raise ValueError(f"SSIM needs images of at least {WINDOW} pixels per side, found {tuple(image.shape)}")
    stacked = torch.stack([image, reference, image * image, reference * reference, image * reference])
    mean_a, mean_b, square_a, square_b, product = _blur(stacked).unbind(dim=0)
    variance_a, variance_b = square_a - mean_a * mean_a, square_b - mean_b * mean_b
    covariance = product - mean_a * mean_b
    luminance = (2 * mean_a * mean_b + LUMINANCE_CONSTANT) / (mean_a * mean_a + mean_b * mean_b + LUMINANCE_CONSTANT)
    contrast = (2 * covariance + CONTRAST_CONSTANT) / (variance_a + variance_b + CONTRAST_CONSTANT)
    return (luminance * contrast).mean(dim=-1)


def sharpness(
    image: Float[Tensor, "*batch height width channel"],
    reference: Float[Tensor, "*batch height width channel"],
    mask: Float[Tensor, "*batch height width"] | None = None,
) -> Float[Tensor, "*batch"]:
    """Strength of an image's fine detail as a share of its reference's: below 1 it is blurred, above 1 speckled.

    Detail is what SSIM's window averages away, measured by its root mean square; a mask weights it as in `ssim`.

    Raises:
        ValueError: the image is smaller than the window.
    """
    margin = WINDOW // 2
    inner = None if mask is None else mask[..., margin:-margin, margin:-margin]
    if min(image.shape[-3:-1]) < WINDOW:
        raise ValueError(f"sharpness needs images of at least {WINDOW} pixels per side, found {tuple(image.shape)}")
    strength = [
        masked_mean((each[..., margin:-margin, margin:-margin, :] - _blur(each)).square().mean(dim=-1), inner).sqrt()
        for each in (image, reference)
    ]
    return strength[0] / strength[1]


def masked_mean(
    values: Float[Tensor, "*batch height width"], mask: Float[Tensor, "*batch height width"] | None
) -> Float[Tensor, "*batch"]:
    """Mean over the image, weighted by a mask if there is one (NaN where it is empty)."""
    if mask is None:
        return values.mean(dim=(-2, -1))
    return (values * mask).sum(dim=(-2, -1)) / mask.sum(dim=(-2, -1))


def _blur(image: Float[Tensor, "*batch height width channel"]) -> Float[Tensor, "*batch inner inner_width channel"]:
    """Weighted mean of each window that lies entirely in the image."""
    offset = torch.arange(WINDOW, device=image.device, dtype=image.dtype) - WINDOW // 2
    window = torch.exp(-0.5 * (offset / SIGMA).square())
    window = window / window.sum()
    if image.device.type == "cuda":
        height, width = (side - WINDOW + 1 for side in image.shape[-3:-1])
        return filtered(filtered(image, Filter(window), -3, height), Filter(window), -2, width)
    planes = image.movedim(-1, -3)
    flat = planes.reshape(-1, 1, *planes.shape[-2:])
    with exact_convolutions():
        flat = torch.nn.functional.conv2d(flat, window[None, None, :, None])
        flat = torch.nn.functional.conv2d(flat, window[None, None, None, :])
    return flat.reshape(*planes.shape[:-2], *flat.shape[-2:]).movedim(-3, -1)
