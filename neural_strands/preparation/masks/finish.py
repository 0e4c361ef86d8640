"""From how likely each pixel is hair to a mask: parts that cannot be hair are dropped, and the border is made loose."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

LOOSE = 1.5
"""Pixels by which masks reach over what was found, at the size they were computed at: hair left out is lost, a border
of background is learned away (about 1 dB in the hair for 4 pixels)."""
LARGE, SPECK = 0.25, 0.01
"""Parts of a mask, against its largest: kept wherever they are, and never kept."""
LIKELY = 0.5
"""Mean probability, by the head alone, from which a small part is kept."""
THICK = 0.008
"""Metres: below the chin, what is thinner than twice this holds nothing together."""
REACH = 0.012
"""Metres that thin parts below the chin may reach beyond thick ones."""


def finish_mask(
    coverage: Float[np.ndarray, "height width"],
    likely: Float[np.ndarray, "height width"],
    below_chin: Bool[np.ndarray, "height width"],
    footprint: float,
    size: tuple[int, int],
) -> UInt8[np.ndarray, "rows columns"]:
    """A mask a little loose, its border a pixel soft.

    Parts are kept that are large or where hair is likely: a beard, or a shadow on the neck, has the colour of hair.
    Below the chin, hair is a part of hair above it, by more than a thin bridge: the shadow inside a collar is not.

    Args:
        coverage: probability of hair.
        likely: the same by the head alone.
        below_chin: pixels that show what is lower than the chin.
        footprint: metres that a pixel spans at the head.
        size: width and height of the mask.
    """
    solid = coverage > 0.5
    firm = _kept(solid & (_opened(solid, THICK / footprint) | ~below_chin), np.where(below_chin, 0.0, likely))
    kept = _connected_to(firm, firm | (solid & (_distance(firm) <= REACH / footprint)))
    soft = np.clip(LOOSE + 1.0 - _distance(kept), 0.0, 1.0) if kept.any() else np.zeros(kept.shape)
    soft = cv2.resize(soft.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.rint(soft * 255).astype(np.uint8)


def _kept(mask: Bool[np.ndarray, "height width"], likely: np.ndarray) -> Bool[np.ndarray, "height width"]:
    """The parts that are large, or no specks and likely."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count == 1:
        return mask
    area = facts[:, cv2.CC_STAT_AREA]
    mean = np.bincount(labels.ravel(), likely.ravel(), count) / np.maximum(area, 1)
    kept = (area >= LARGE * area[1:].max()) | ((mean > LIKELY) & (area >= SPECK * area[1:].max()))
    kept[0] = False
    return kept[labels]


def _connected_to(seeds: Bool[np.ndarray, "height width"], mask: np.ndarray) -> Bool[np.ndarray, "height width"]:
    """The parts of a mask that hold a seed; all seeds lie in it."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8))
    part = np.asarray(labels, dtype=np.int64)
    held = np.zeros(count, dtype=bool)
    held[part[seeds]] = True
    return held[part]


def _opened(mask: Bool[np.ndarray, "height width"], radius: float) -> Bool[np.ndarray, "height width"]:
    """What of a mask a disc of this radius, in pixels, can cover without leaving the mask."""
    side = 2 * max(round(radius), 1) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0


def _distance(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
    """Pixels from each pixel to the mask; far where it is empty."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5))
