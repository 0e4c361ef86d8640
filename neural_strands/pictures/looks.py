"""How likely a pixel's look, its colour and its texture, is in a part of the pictures: smoothed histograms.

Colour alone takes skin in shadow for dark hair and fair tips for the wall behind them. Hair has fine streaks that run
side by side, which skin and most walls have not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int64, UInt8
from scipy.ndimage import gaussian_filter

BINS = 32
"""Cells along each axis of the colour space."""
SMOOTHING = 1.2
"""Standard deviation of the smoothing of colours, cells."""
FLOOR = 0.02
"""Share of all colours alike that is mixed in: a colour never seen is unlikely, not impossible."""

STRENGTHS, COHERENCES = 16, 4
"""Cells of a texture: how strong its streaks are, in octaves of half a stop each, and how parallel."""
WEAKEST = 2.0**-8
"""Strength of the weakest cell: slope of the lightness over the lightness, a pixel."""
WINDOW = 2.0
"""Standard deviation of the window in which a texture is judged, pixels."""
DARKEST = 0.03
"""Added to the lightness that slopes are compared with, so that noise in black is no texture."""
TEXTURE_FLOOR = 0.05
TEXTURE_WEIGHT = 0.5
"""Exponent of a texture's likelihood: neighbouring pixels share a window, and do not speak independently."""


@dataclass(frozen=True)
class LookHistogram:
    """A density over colours and one over textures, taken as independent.

    Attributes:
        colour: over CIE Lab, quantised; mean 1.
        texture: over strength and coherence; mean 1.
    """

    colour: Float[np.ndarray, " colour_cell"]
    texture: Float[np.ndarray, " texture_cell"]

    @classmethod
    def of(cls, cells: Sequence[np.ndarray], weights: Sequence[np.ndarray] | None = None) -> "LookHistogram":
        """From the cells (`look_cells`) of chosen pixels; each array counts alike, empty ones not at all.

        Args:
            cells: (pixel, 2), one array a view.
            weights: of the pixels, in the same arrays; all alike if None.
        """
        colour = _counts([chosen[:, 0] for chosen in cells], weights, BINS**3).reshape(BINS, BINS, BINS)
        texture = _counts([chosen[:, 1] for chosen in cells], weights, STRENGTHS * COHERENCES)
        texture = texture.reshape(STRENGTHS, COHERENCES)
        return cls(
            _density(gaussian_filter(colour, SMOOTHING, mode="nearest"), FLOOR),
            _density(gaussian_filter(texture, (1.0, 0.0), mode="nearest"), TEXTURE_FLOOR),
        )

    def __call__(self, cells: Int64[np.ndarray, "*pixel 2"]) -> Float[np.ndarray, "*pixel"]:
        """The density at each cell."""
        return self.colour[cells[..., 0]] * self.texture[cells[..., 1]] ** TEXTURE_WEIGHT


def look_cells(picture: UInt8[np.ndarray, "height width 3"]) -> Int64[np.ndarray, "height width 2"]:
    """The cells of colour and texture of each pixel of an RGB picture, each as one number."""
    lab = cv2.cvtColor(picture, cv2.COLOR_RGB2LAB).astype(np.float32)
    return np.stack([_colour_cells(lab), _texture_cells(lab[..., 0] / 255.0)], axis=-1)


def _colour_cells(lab: np.ndarray) -> np.ndarray:
    """Lightness spans its range; the two colour axes are stretched threefold about grey, where skin and hair lie."""
    stretched = lab.copy()
    stretched[..., 1:] = 128.0 + 3.0 * (lab[..., 1:] - 128.0)
    cell = np.clip(stretched * (BINS / 256.0), 0, BINS - 1).astype(np.int64)
    return (cell[..., 0] * BINS + cell[..., 1]) * BINS + cell[..., 2]


def _texture_cells(lightness: np.ndarray) -> np.ndarray:
    """Strength and coherence of the structure tensor, the strength relative to the lightness around."""
    across, down = (cv2.Scharr(lightness, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((1, 0), (0, 1)))
    products = (cv2.multiply(across, across), cv2.multiply(down, down), cv2.multiply(across, down))
    xx, yy, xy, mean = (np.asarray(cv2.GaussianBlur(each, (0, 0), WINDOW)) for each in (*products, lightness))
    trace = xx + yy
    coherence = np.hypot(xx - yy, 2.0 * xy) / (trace + 1e-8)
    octave = np.log2(np.sqrt(trace) / (mean + DARKEST) / WEAKEST + 1e-6)
    strength = np.clip(2.0 * octave, 0, STRENGTHS - 1).astype(np.int64)
    return strength * COHERENCES + np.clip(coherence * COHERENCES, 0, COHERENCES - 1).astype(np.int64)


def _counts(cells: Sequence[np.ndarray], weights: Sequence[np.ndarray] | None, size: int) -> np.ndarray:
    """How often each cell occurs, as a share of its array, summed over the arrays."""
    counts = np.zeros(size)
    for number, chosen in enumerate(cells):
        if chosen.size:
            weight = None if weights is None else weights[number]
            counts += np.bincount(chosen, weight, minlength=size) / chosen.size
    return counts


def _density(smooth: np.ndarray, floor: float) -> np.ndarray:
    """Flat, with mean 1, and a share of all cells alike."""
    total = smooth.sum()
    density = smooth.ravel() / total * smooth.size if total > 0 else np.ones(smooth.size)
    return (1.0 - floor) * density + floor
