"""2D orientation of hair in an image and its confidence, by an oriented filter bank (after Paris et al. 2008).

Angles are in [0, pi), from the image's x axis towards its y axis (down). The response at an angle is the energy of a
quadrature pair of Gabor filters, averaged over a small window: strands are thinner than a pixel, so streaks have any
phase, and the even filter alone would miss half of them.
"""

import functools
import math
from dataclasses import dataclass
from typing import Annotated

import scipy.fft
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.raster.gaussian_blur import gaussian_blur

LUMA = (0.299, 0.587, 0.114)
"""Rec. 601 weights of red, green and blue."""


@dataclass(frozen=True)
class OrientationConfig:
    """The filter bank."""

    angles: Annotated[int, Between(4, 180)] = 24
    """Filters between 0 and pi; the peak is found to a fraction of their spacing."""
    scales: tuple[Annotated[float, Between(0.1, 100)], ...] = (1.0,)
    """Sizes of the filters, as multiples of the lengths below; responses are summed."""
    along: Annotated[float, Between(0.1, 100)] = 4.0
    """Standard deviation of the window along the filter's line, pixels."""
    across: Annotated[float, Between(0.1, 100)] = 1.8
    """Standard deviation of the window across it, pixels."""
    wavelength: Annotated[float, Between(0.1, 100)] = 4.0
    """Wavelength of the filter's carrier, pixels."""
    window: Annotated[float, Between(0, 100)] = 2.5
    """Standard deviation of the window over which energy is averaged, pixels; 0 for none."""
    fine: Annotated[float, Between(0.1, 100)] = 0.4
    """Inner standard deviation of the difference of Gaussians, pixels."""
    coarse: Annotated[float, Between(0.1, 1000)] = 10.0
    """Outer standard deviation of the difference of Gaussians, pixels."""


@dataclass(frozen=True)
class OrientationMap:
    """Orientation per pixel.

    Attributes:
        angle: orientation, in [0, pi).
        confidence: 1 - V / (pi^2 / 12), in [0, 1], with V the variance of the response around its peak; 0 if isotropic.
        energy: response at the peak, in units of luma.
    """

    angle: Float[Tensor, "height width"]
    confidence: Float[Tensor, "height width"]
    energy: Float[Tensor, "height width"]


def luma(image: Float[Tensor, "height width 3"]) -> Float[Tensor, "height width"]:
    """Brightness of an sRGB-encoded image."""
    return image @ image.new_tensor(LUMA)


def orientation_map(brightness: Float[Tensor, "height width"], config: OrientationConfig) -> OrientationMap:
    """Find the orientation of the streaks at each pixel."""
    band = gaussian_blur(brightness, config.fine) - gaussian_blur(brightness, config.coarse)
    height, width = band.shape
    margin = math.ceil(3 * config.along * max(config.scales))
    padded = torch.nn.functional.pad(band[None, None], (margin,) * 4, mode="replicate")[0, 0]
    size = (scipy.fft.next_fast_len(padded.shape[0]), scipy.fft.next_fast_len(padded.shape[1]))
    spectrum = torch.fft.fft2(padded, s=size)
    energy = brightness.new_zeros(config.angles, height, width)
    for scale in config.scales:
        bank = _filter_bank(config, scale, size, brightness.device)
        for k in range(config.angles):
            response = torch.fft.ifft2(spectrum * bank[k])[margin : margin + height, margin : margin + width]
            energy[k] += response.abs()
    return _peak(gaussian_blur(energy, config.window))


def angle_difference(first: Float[Tensor, "*batch"], second: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Distance between orientations (pi-periodic), in [0, pi / 2]."""
    difference = (first - second).remainder(math.pi)
    return torch.minimum(difference, math.pi - difference)


@functools.lru_cache(maxsize=8)
def _filter_bank(
    config: OrientationConfig, scale: float, size: tuple[int, int], device: torch.device
) -> Float[Tensor, "angle height width"]:
    """Spectra of complex Gabor filters (even part real, odd part imaginary), of unit gain at the carrier.

    The spectrum of a Gaussian window with standard deviations (along, across), times a carrier across the line, is a
    Gaussian with standard deviations 1 / (2 pi along), 1 / (2 pi across) around the carrier's frequency.
    """
    y, x = torch.meshgrid(torch.fft.fftfreq(size[0]), torch.fft.fftfreq(size[1]), indexing="ij")
    bank = []
    for k in range(config.angles):
        cosine, sine = math.cos(math.pi * k / config.angles), math.sin(math.pi * k / config.angles)
        along = (x * cosine + y * sine) * (2 * math.pi * config.along * scale)
        across = (y * cosine - x * sine) * scale - 1 / config.wavelength
        bank.append(torch.exp(-0.5 * along**2 - 0.5 * (across * 2 * math.pi * config.across) ** 2))
    return torch.stack(bank).to(device)


def _peak(response: Float[Tensor, "angle height width"]) -> OrientationMap:
    """Peak of the response, by a parabola through its maximum and two neighbours, and the variance around it."""
    count = len(response)
    step = math.pi / count
    index = response.argmax(dim=0, keepdim=True)
    before, top, after = (response.gather(0, (index + shift) % count)[0] for shift in (-1, 0, 1))
    curvature = before - 2 * top + after
    offset = torch.where(curvature < 0, 0.5 * (before - after) / curvature.clamp(max=-1e-12), 0.0)
    angle = ((index[0] + offset.clamp(-0.5, 0.5)) * step).remainder(math.pi)
    weighted = torch.zeros_like(angle)
    for k in range(count):
        weighted += angle_difference(angle, torch.full_like(angle, k * step)) ** 2 * response[k]
    variance = weighted / response.sum(dim=0).clamp(min=1e-12)
    confidence = (1 - variance / (math.pi**2 / 12)).clamp(0, 1)
    return OrientationMap(angle, torch.where(top > 1e-6, confidence, 0.0), top)
