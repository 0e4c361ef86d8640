"""How likely a colour is in a part of the pictures: a smoothed histogram."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

BINS = 32
"""Cells along each axis of the colour space."""
SMOOTHING = 1.2
"""Standard deviation of the smoothing, cells."""
FLOOR = 0.02
"""Share of all colours alike that is mixed in: a colour never seen is unlikely, not impossible."""


@dataclass(frozen=True)
class ColourHistogram:
    """A density over CIE Lab, quantised.

    Attributes:
        density: (BINS, BINS, BINS), mean 1.
    """

    density: np.ndarray

    @classmethod
    def of(cls, cells: Sequence[np.ndarray], weights: Sequence[np.ndarray] | None = None) -> "ColourHistogram":
        """From the cells (`colour_cells`) of chosen pixels; each array counts alike, empty ones not at all.

        Args:
            cells: one array a view.
            weights: of the pixels, in the same arrays; all alike if None.
        """
        counts = np.zeros(BINS**3)
        for number, chosen in enumerate(cells):
            if chosen.size:
                weight = None if weights is None else weights[number].ravel()
                counts += np.bincount(chosen.ravel(), weight, minlength=BINS**3) / chosen.size
        smooth = gaussian_filter(counts.reshape(BINS, BINS, BINS), SMOOTHING, mode="nearest")
        total = smooth.sum()
        density = smooth / total * BINS**3 if total > 0 else np.ones_like(smooth)
        return cls((1.0 - FLOOR) * density + FLOOR)

    def __call__(self, cells: np.ndarray) -> np.ndarray:
        """The density at each cell."""
        return self.density.ravel()[cells]


def colour_cells(picture: np.ndarray) -> np.ndarray:
    """The cell of each pixel of an 8-bit RGB picture, as one number.

    Lightness spans its range; the two colour axes are stretched threefold about grey, where skin and hair lie.
    """
    lab = cv2.cvtColor(picture, cv2.COLOR_RGB2LAB).astype(np.float32)
    lab[..., 1:] = 128.0 + 3.0 * (lab[..., 1:] - 128.0)
    cell = np.clip(lab * (BINS / 256.0), 0, BINS - 1).astype(np.int64)
    return (cell[..., 0] * BINS + cell[..., 1]) * BINS + cell[..., 2]
