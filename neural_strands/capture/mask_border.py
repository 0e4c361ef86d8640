"""Where hair masks end against where the photographs' hair ends, and masks that are grown or shrunk by the difference.

Segmenters and people err on one side: their masks end some pixels inside the hair, or beyond it. Stereo looks for hair
only where masks have some, and what is hair by mistake bends the flow, so a few pixels cost much. The photographs tell:
pixels well inside the masks have the look of hair, those well outside another, and where both are equally common, on
average over all views, hair ends.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from neural_strands.capture.capture import Capture
from neural_strands.capture.findings import Finding
from neural_strands.pictures.looks import LookHistogram, look_cells

MOST_VIEWS = 12
"""Views that are looked at."""
LONGEST_SIDE = 1024
"""Pixels along the longer side of a view as it is looked at."""
WELL_INSIDE, WELL_OUTSIDE, NEAR = 6.0, 8.0, 30.0
"""Pixels from a mask's border at which pixels surely show hair, or surely none, and up to which the latter count."""
FARTHEST = 8
"""Pixels up to which hair is looked for beyond the border, and a little less far within."""
FEWEST = 50
"""Pixels at a distance from the border that tell something."""
SURE = (0.75, 0.4)
"""Shares of pixels that look like hair at the inner and the outer end, without which nothing is told."""
TIGHT, WIDE = 1.5, -2.5
"""Pixels from which masks are too tight, and too wide: a border of a pixel or two is wanted."""
WANTED = 1.0
"""Pixels by which masks that are shrunk still reach beyond the hair."""


def mask_border(capture: Capture) -> float | None:
    """How far hair reaches beyond the masks' borders, pixels of views reduced to `LONGEST_SIDE`; None if not told.

    Negative where the masks reach beyond the hair.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    masked = [index for index, view in enumerate(capture.files) if view.hair_mask_path is not None]
    chosen = masked[:: max(1, -(-len(masked) // MOST_VIEWS))]
    return border_of([_looked_at(capture, index) for index in chosen])


def border_of(views: Sequence[tuple[np.ndarray, Bool[np.ndarray, "height width"]]]) -> float | None:
    """The same for 8-bit RGB pictures and where their masks have hair."""
    seen = [(look_cells(picture), _signed_distance(mask)) for picture, mask in views if mask.any() and not mask.all()]
    inner = [cells[distance < -WELL_INSIDE] for cells, distance in seen]
    outer = [cells[(distance > WELL_OUTSIDE) & (distance < NEAR)] for cells, distance in seen]
    if sum(map(len, inner)) < FEWEST or sum(map(len, outer)) < FEWEST:
        return None
    hair, other = LookHistogram.of(inner), LookHistogram.of(outer)
    like_hair = [(hair(cells) > other(cells), distance) for cells, distance in seen]
    places = range(2 - FARTHEST, FARTHEST + 1)
    shares = [_share_at(like_hair, place) for place in places]
    if any(share is None for share in shares):
        return None
    curve = np.array(shares, dtype=float)
    if curve[0] < SURE[0] or curve[-1] > SURE[1]:
        return None
    after = int(np.argmax(curve < 0.5))
    return float(places[after] - (0.5 - curve[after]) / (curve[after - 1] - curve[after]))


def mask_growth(border: float | None) -> int:
    """Pixels by which to grow masks whose border is that far within the hair; negative to shrink them, mostly 0."""
    if border is None or WIDE < border < TIGHT:
        return 0
    return round(border) if border > 0 else round(border + WANTED)


def with_corrected_masks(capture: Capture, judged: Capture, say: Callable[[str], None]) -> Capture:
    """A capture whose hair masks end where its hair does.

    Args:
        capture: all views.
        judged: those of them that may be looked at.
        say: is told of a correction.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    growth = mask_growth(mask_border(judged))
    if growth == 0:
        return capture
    say(f"{_fault(growth, judged)}; they are {'grown' if growth > 0 else 'shrunk'} by as much")
    return replace(capture, mask_growth=growth / min(_longest_side(judged), LONGEST_SIDE))


def check_border(capture: Capture) -> Finding | None:
    """Masks that end elsewhere than the hair; None where they do not, or where that is not told.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    growth = mask_growth(mask_border(capture))
    if growth == 0:
        return None
    action = "fits correct that; masks that follow the hair, or lie a pixel or two outside, are better still"
    return Finding("mask border", "warning", _fault(growth, capture), action)


def _fault(growth: int, capture: Capture) -> str:
    """What is wrong with masks that should be grown by so many pixels, in pixels of the largest photographs."""
    side = _longest_side(capture)
    pixels = round(abs(growth) * side / min(side, LONGEST_SIDE))
    if growth > 0:
        return f"hair masks end about {pixels} pixels inside the hair"
    return f"hair masks reach about {pixels} pixels too far beyond the hair"


def _longest_side(capture: Capture) -> int:
    return max(max(camera.width, camera.height) for camera in capture.cameras)


def _looked_at(capture: Capture, index: int) -> tuple[np.ndarray, Bool[np.ndarray, "height width"]]:
    picture, mask = capture.image(index).numpy(), capture.hair_mask(index)
    assert mask is not None
    height, width = picture.shape[:2]
    scale = min(1.0, LONGEST_SIDE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small, hair = (cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (picture, mask.numpy()))
    return np.rint(np.clip(small, 0, 1) * 255).astype(np.uint8), hair > 0.5


def _signed_distance(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
    """Pixels to the border, negative inside."""
    inside = mask.astype(np.uint8)
    outer, inner = (np.asarray(cv2.distanceTransform(each, cv2.DIST_L2, 5)) for each in (1 - inside, inside))
    return outer - inner + np.where(mask, 0.5, -0.5)


def _share_at(like_hair: Sequence[tuple[np.ndarray, np.ndarray]], place: int) -> float | None:
    """Mean over the views of the share of the pixels at a distance that look like hair."""
    bands = [(like, np.abs(distance - place) <= 0.5) for like, distance in like_hair]
    shares = [float(like[band].mean()) for like, band in bands if band.sum() >= FEWEST]
    return sum(shares) / len(shares) if shares else None
