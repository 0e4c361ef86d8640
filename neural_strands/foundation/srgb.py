"""The sRGB transfer curve (IEC 61966-2-1).

Light adds up in linear values, so whatever averages, filters or composites colours does it there. Files, scores and
losses use the encoded values, whose steps are about equally visible everywhere.
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
    """Encode linear light. Black's straight line goes on below zero and the curve beyond one, so nothing is lost."""
    bright = 1.055 * linear.clamp(min=LARGEST_DARK) ** (1 / 2.4) - 0.055
    return torch.where(linear <= LARGEST_DARK, DARK_SLOPE * linear, bright)


def to_linear(encoded: Float[Tensor, "*size"]) -> Float[Tensor, "*size"]:
    """Decode to linear light: the inverse of `to_srgb`, for values of any size."""
    dark = LARGEST_DARK * DARK_SLOPE
    bright = ((encoded.clamp(min=dark) + 0.055) / 1.055) ** 2.4
    return torch.where(encoded <= dark, encoded / DARK_SLOPE, bright)


def linear_samples(encoded: np.ndarray) -> np.ndarray:
    """Stored samples of 8 or 16 bits, decoded to 16 bits of linear light; those of 8 bits survive the way back."""
    return _curve(encoded.dtype.str, decode=True)[encoded]


def srgb_samples(linear: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Samples of 16 bits of linear light, encoded as `dtype` (8 or 16 bits) stores them."""
    return _curve(np.dtype(dtype).str, decode=False)[linear]


@cache
def _curve(dtype: str, *, decode: bool) -> np.ndarray:
    """The curve for every value that a sample can have."""
    top, stored = np.iinfo(np.uint16).max, np.iinfo(dtype).max
    size, most, result, curve = (stored, top, np.uint16, to_linear) if decode else (top, stored, dtype, to_srgb)
    values = torch.arange(size + 1, dtype=torch.float64) / size
    return (curve(values) * most).round().numpy().astype(result)
