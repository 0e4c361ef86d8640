"""The sRGB transfer curve (IEC 61966-2-1).

Light is additive in linear values, so colours are averaged, filtered and composited there. Files, scores and losses use
encoded values, whose steps are about equally visible everywhere.
"""

from functools import cache

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

LARGEST_DARK = 0.0031308
"""Linear value up to which the curve is a straight line."""
DARK_SLOPE = 12.92
"""Slope of that line."""


def to_srgb(linear: Float[Tensor, "*size"]) -> Float[Tensor, "*size"]:
    """Encode linear light. The curve is extended below zero and above one, so that it is invertible everywhere."""
    bright = 1.055 * linear.clamp(min=LARGEST_DARK) ** (1 / 2.4) - 0.055
    return torch.where(linear <= LARGEST_DARK, DARK_SLOPE * linear, bright)


def to_linear(encoded: Float[Tensor, "*size"]) -> Float[Tensor, "*size"]:
    """Decode to linear light: the inverse of `to_srgb`, for values of any size."""
    dark = LARGEST_DARK * DARK_SLOPE
    bright = ((encoded.clamp(min=dark) + 0.055) / 1.055) ** 2.4
    return torch.where(encoded <= dark, encoded / DARK_SLOPE, bright)


def linear_samples(encoded: np.ndarray) -> np.ndarray:
    """Decode samples of 8 or 16 bits to 16 bits of linear light; the round trip of 8-bit samples is exact."""
    return _curve(encoded.dtype.str, decode=True)[encoded]


def srgb_samples(linear: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Encode 16-bit linear samples to `dtype` (8 or 16 bits)."""
    return _curve(np.dtype(dtype).str, decode=False)[linear]


@cache
def _curve(dtype: str, *, decode: bool) -> np.ndarray:
    """Lookup table of the curve for every value of a sample."""
    top, stored = np.iinfo(np.uint16).max, np.iinfo(dtype).max
    size, most, result, curve = (stored, top, np.uint16, to_linear) if decode else (top, stored, dtype, to_srgb)
    values = torch.arange(size + 1, dtype=torch.float64) / size
    return (curve(values) * most).round().numpy().astype(result)
