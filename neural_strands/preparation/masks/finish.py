"""Turns the probability of hair into a mask: drops parts that cannot be hair, and adds a margin of low values."""

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

EDGE, MARGIN = 0.5, 3.0
"""Value of a mask at the border of the segmented hair, and pixels over which it falls to zero outside, at the size at
which masks are computed. Pictures are compared with the hair itself, where the mask exceeds one half. But hair that is
left out of the volume in which it is searched is lost, so stereo and the hull also use places of lower values."""
LARGE, SPECK = 0.25, 0.01
"""Sizes of a mask's parts relative to the largest: above the first a part is always kept, below the second never."""
LIKELY = 0.5
"""Least mean probability, from the head alone, of a small part that is kept."""
NOT_HAIR, HAIR = 0.3, 0.6
"""Shares of a small part in which other views agree on hair: up to the first it is dropped, from the second on kept."""
THICK = 0.008
"""Radius, metres: below the chin, bridges thinner than twice this do not connect parts."""
REACH = 0.012
"""Length by which thin parts below the chin may extend beyond thick ones, metres."""

Judge = Callable[[np.ndarray, np.ndarray], Float[np.ndarray, " part"]]
"""Takes an image with the number of each pixel's part, and some of these numbers; returns the share of each of these
parts in which other views agree on hair."""


def parts_of_hair(
    coverage: Float[np.ndarray, "height width"],
    likely: Float[np.ndarray, "height width"],
    below_chin: Bool[np.ndarray, "height width"],
    footprint: float,
    agreed: Judge | None = None,
) -> Bool[np.ndarray, "height width"]:
    """Choose the parts of a picture that show hair.

    Parts are kept if they are large or if hair is likely there: a beard, or a shadow on the neck, has the colour of
    hair. Below the chin, hair must be connected with hair above it by more than a thin bridge, so that the shadow
    inside a collar is dropped. Where other views clearly agree about a part, that decides.

    Args:
        coverage: probability of hair.
        likely: probability of hair from the head alone.
        below_chin: pixels that show something lower than the chin.
        footprint: width of a pixel at the head, metres.
        agreed: asks the other views; None if there are too few.
    """
    solid = coverage > 0.5
    thick = solid & (_opened(solid, THICK / footprint) | ~below_chin)
    firm = _kept(thick, np.where(below_chin, 0.0, likely), agreed)
    return _connected_to(firm, firm | (solid & (_distance(firm) <= REACH / footprint)))


def soft_mask(kept: Bool[np.ndarray, "height width"], size: tuple[int, int]) -> UInt8[np.ndarray, "rows columns"]:
    """Turn the pixels of hair into a mask of a width and height: 1 there, less than one half in a margin around it."""
    # The border runs half a pixel before the middle of the nearest pixel outside.
    around = EDGE * np.clip(1.0 - (_distance(kept) - 0.5) / MARGIN, 0.0, 1.0)
    soft = np.where(kept, 1.0, around)
    soft = cv2.resize(soft.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    return np.rint(soft * 255).astype(np.uint8)


def _kept(
    mask: Bool[np.ndarray, "height width"],
    likely: np.ndarray,
    agreed: Judge | None,
) -> Bool[np.ndarray, "height width"]:
    """The parts that are large, or at least no specks and, by other views or where it lies, likely."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    if count == 1:
        return mask
    area = facts[:, cv2.CC_STAT_AREA]
    kept, doubtful = area >= LARGE * area[1:].max(), area >= SPECK * area[1:].max()
    kept[0] = False
    doubtful[0] = False
    doubtful &= ~kept
    names = np.flatnonzero(doubtful)
    probable = np.bincount(labels.ravel(), likely.ravel(), count)[names] > LIKELY * area[names]
    if agreed is not None:
        shares = agreed(labels, names)
        probable = (shares >= HAIR) | (probable & (shares > NOT_HAIR))
    kept[names] = probable
    return kept[labels]


def _connected_to(seeds: Bool[np.ndarray, "height width"], mask: np.ndarray) -> Bool[np.ndarray, "height width"]:
    """The connected parts of a mask that contain a seed; all seeds lie in the mask."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8))
    part = np.asarray(labels, dtype=np.int64)
    held = np.zeros(count, dtype=bool)
    held[part[seeds]] = True
    return held[part]


def _opened(mask: Bool[np.ndarray, "height width"], radius: float) -> Bool[np.ndarray, "height width"]:
    """Morphological opening of a mask by a disc of this radius, in pixels."""
    side = 2 * max(round(radius), 1) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc) > 0


def _distance(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
    """Distance of each pixel from the mask, pixels; large if the mask is empty."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5))
