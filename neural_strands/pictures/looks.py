"""Densities of a pixel's look (its colour and texture) in parts of pictures, as smoothed histograms.

By colour alone, shadowed skin looks like dark hair, and fair tips like the wall behind them. Hair has fine parallel
streaks, which skin and most walls lack.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8, UInt16
from scipy.ndimage import gaussian_filter

BINS = 32
"""Cells along each axis of the colour space."""
SMOOTHING = 1.2
"""Standard deviation of the smoothing of colours, cells."""
FLOOR = 0.02
"""Weight of a uniform density that is mixed in, so that unseen colours are unlikely but not impossible."""

STRENGTHS, COHERENCES = 16, 4
"""Numbers of cells for the strength of a texture's streaks (half a stop each) and for how parallel they are."""
WEAKEST = 2.0**-8
"""Strength of the weakest cell: relative slope of the lightness, per pixel."""
WINDOW = 2.0
"""Standard deviation of the window over which a texture is measured, pixels."""
DARKEST = 0.03
"""Added to the lightness by which slopes are divided, so that noise in black areas is not a texture."""
TEXTURE_FLOOR = 0.05
TEXTURE_WEIGHT = 0.5
"""Exponent on a texture's likelihood, below 1 because neighbouring pixels share a window and are not independent."""
UNMIXED = 0.1
"""Quantile at which `LookHistogram.largest_share` takes the ratio of two looks."""


@dataclass(frozen=True)
class LookHistogram:
    """A density over colours and one over textures, assumed to be independent.

    Attributes:
        colour: over CIE Lab, quantised; mean 1.
        texture: over strength and coherence; mean 1.
    """

    colour: Float[np.ndarray, " colour_cell"]
    texture: Float[np.ndarray, " texture_cell"]

    @classmethod
    def of(cls, cells: Sequence[np.ndarray], weights: Sequence[np.ndarray] | None = None) -> "LookHistogram":
        """Estimate the densities from the cells (`look_cells`) of chosen pixels.

        Args:
            cells: (pixel, 2), one array per view; all non-empty arrays have equal weight.
            weights: weights of the pixels, in the same arrays; all equal if None.
        """
        colour = _counts([chosen[:, 0] for chosen in cells], weights, BINS**3).reshape(BINS, BINS, BINS)
        texture = _counts([chosen[:, 1] for chosen in cells], weights, STRENGTHS * COHERENCES)
        texture = texture.reshape(STRENGTHS, COHERENCES)
        return cls(
            _density(gaussian_filter(colour, SMOOTHING, mode="nearest"), FLOOR),
            _density(gaussian_filter(texture, (1.0, 0.0), mode="nearest"), TEXTURE_FLOOR),
        )

    def largest_share(self, other: "LookHistogram") -> float:
        """Largest share of another look that can be a part of this one.

        If this look is a mixture of the other one and an unknown one, the share of the other one is at most the
        smallest ratio of their densities. A low quantile of the ratio is taken instead, because the same material may
        look a little different in the mixture.
        """
        return min(1.0, *(_low_ratio(own, others) for own, others in self._pairs(other)))

    def without(self, other: "LookHistogram", share: float) -> "LookHistogram":
        """The look that remains if another one, of this share, is taken out."""
        return LookHistogram(
            *(
                _density(np.maximum(own - share * others, 0.0), floor)
                for (own, others), floor in zip(self._pairs(other), (FLOOR, TEXTURE_FLOOR), strict=True)
            )
        )

    def _pairs(self, other: "LookHistogram") -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        return (self.colour, other.colour), (self.texture, other.texture)

    def __call__(self, cells: UInt16[np.ndarray, "*pixel 2"]) -> Float[np.ndarray, "*pixel"]:
        """The density at each cell."""
        return self.colour[cells[..., 0]] * self.texture[cells[..., 1]] ** TEXTURE_WEIGHT


def _low_ratio(density: np.ndarray, other: np.ndarray) -> float:
    """Quantile `UNMIXED`, over the other density, of the ratio of the densities."""
    ratio = density / other
    order = np.argsort(ratio)
    below = np.cumsum(other[order])
    return float(ratio[order[np.searchsorted(below, UNMIXED * below[-1])]])


def look_cells(picture: UInt8[np.ndarray, "height width 3"]) -> UInt16[np.ndarray, "height width 2"]:
    """Indices of the colour cell and the texture cell of each pixel of an RGB picture."""
    lab = cv2.cvtColor(picture, cv2.COLOR_RGB2LAB).astype(np.float32)
    return np.stack([_colour_cells(lab), _texture_cells(lab[..., 0] / 255.0)], axis=-1).astype(np.uint16)


def _colour_cells(lab: np.ndarray) -> np.ndarray:
    """Indices of colour cells; the two chroma axes are stretched threefold around grey, where skin and hair are."""
    stretched = lab.copy()
    stretched[..., 1:] = 128.0 + 3.0 * (lab[..., 1:] - 128.0)
    cell = np.clip(stretched * (BINS / 256.0), 0, BINS - 1).astype(np.int64)
    return (cell[..., 0] * BINS + cell[..., 1]) * BINS + cell[..., 2]


def _texture_cells(lightness: np.ndarray) -> np.ndarray:
    """Indices of texture cells: strength (relative to the local lightness) and coherence of the structure tensor."""
    across, down = (cv2.Scharr(lightness, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((1, 0), (0, 1)))
    products = (cv2.multiply(across, across), cv2.multiply(down, down), cv2.multiply(across, down))
    xx, yy, xy, mean = (np.asarray(cv2.GaussianBlur(each, (0, 0), WINDOW)) for each in (*products, lightness))
    trace = xx + yy
    coherence = np.hypot(xx - yy, 2.0 * xy) / (trace + 1e-8)
    octave = np.log2(np.sqrt(trace) / (mean + DARKEST) / WEAKEST + 1e-6)
    strength = np.clip(2.0 * octave, 0, STRENGTHS - 1).astype(np.int64)
    return strength * COHERENCES + np.clip(coherence * COHERENCES, 0, COHERENCES - 1).astype(np.int64)


def _counts(cells: Sequence[np.ndarray], weights: Sequence[np.ndarray] | None, size: int) -> np.ndarray:
    """Share of each cell in its array, summed over the arrays."""
    counts = np.zeros(size)
    for number, chosen in enumerate(cells):
        if chosen.size:
            weight = None if weights is None else weights[number]
            counts += np.bincount(chosen, weight, minlength=size) / chosen.size
    return counts


def _density(smooth: np.ndarray, floor: float) -> np.ndarray:
    """Flatten and normalise to mean 1, mixed with a uniform density."""
    total = smooth.sum()
    density = smooth.ravel() / total * smooth.size if total > 0 else np.ones(smooth.size)
    return (1.0 - floor) * density + floor
