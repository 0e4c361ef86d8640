"""Measures how far hair masks end from the hair in the photographs, and grows or shrinks them accordingly.

Segmentation programs and people have a bias: their masks end some pixels inside the hair, or beyond it. Stereo searches
hair only inside the masks, and pixels masked by mistake bend the flow, so a few pixels matter. The offset is measured
in the photographs: pixels well inside the masks show what hair looks like, those well outside what the rest looks like,
and the hair ends where, on average over all views, both looks are equally common.

Mattes of sparse hair are partly covered nearly everywhere: where they fall below a half, hair goes on, but so do they.
Masks are therefore too tight only if hair also goes on where they are hardly covered any more.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from neural_strands.capture.capture import Capture
from neural_strands.capture.findings import Finding
from neural_strands.capture.images import reduced
from neural_strands.pictures.looks import LookHistogram, look_cells

MOST_VIEWS = 12
"""Largest number of views examined."""
LONGEST_SIDE = 1024
"""Longer side to which views are reduced, pixels."""
WELL_INSIDE, WELL_OUTSIDE, NEAR = 6.0, 8.0, 30.0
"""Distances from a mask's border, pixels: beyond the first inside, pixels certainly show hair; between the second and
the third outside, they certainly show none."""
FARTHEST = 8
"""Distance from the border up to which the hair's end is searched, pixels; slightly less far inside."""
FEWEST = 50
"""Fewest pixels at a distance from the border that give a usable share."""
SURE = (0.75, 0.4)
"""The share of pixels that look like hair must be above the first at the inner end of the search, and below the second
at the outer end; otherwise the offset is unknown."""
TIGHT, WIDE = 1.5, -2.5
"""Offsets above the first mean masks that are too tight, below the second too wide, pixels; a margin of a pixel or two
is fine."""
COVERED, FAINT = 0.5, 0.3
"""Values of a mask at which it ends: where pictures are compared, and where stereo takes no pixel for hair any more."""
TIGHT_FAINT = 1.9
"""Masks that are too tight also end this far inside the hair at their faint end, pixels: mattes of sparse hair end 1.1
to 1.2 pixels inside it, those of dense hair 2.7 to 3.3 when they are eroded by 4 pixels."""
WANTED = 1.0
"""Margin beyond the hair that shrunk masks keep, pixels."""


def mask_growth(capture: Capture) -> int:
    """Measure by how many pixels masks should be grown; negative to shrink them, usually 0.

    Args:
        capture: photographs and hair masks.

    Returns:
        Pixels of views reduced to `LONGEST_SIDE`; 0 if the photographs do not determine it.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    masked = [index for index, view in enumerate(capture.files) if view.hair_mask_path is not None]
    chosen = masked[:: max(1, -(-len(masked) // MOST_VIEWS))]
    return growth_of([_reduced_view(capture, index) for index in chosen])


def growth_of(views: Sequence[tuple[np.ndarray, Float[np.ndarray, "height width"]]]) -> int:
    """Like `mask_growth`, for pairs of an 8-bit RGB picture and the coverage of its pixels by hair, from 0 to 1."""
    border = border_of([(picture, coverage > COVERED) for picture, coverage in views])
    tight = border is not None and border >= TIGHT
    faint = border_of([(picture, coverage > FAINT) for picture, coverage in views]) if tight else None
    return needed_growth(border, faint)


def needed_growth(border: float | None, faint: float | None) -> int:
    """Pixels by which to grow masks that end this far inside the hair; negative to shrink them, usually 0.

    Args:
        border: how far hair extends beyond where the masks fall below `COVERED`, pixels, if that is known.
        faint: the same for `FAINT`; only counts for masks that are too tight.
    """
    if border is None or WIDE < border < TIGHT:
        return 0
    if border < 0:
        return round(border + WANTED)
    return 0 if faint is None or faint < TIGHT_FAINT else round(border)


def border_of(views: Sequence[tuple[np.ndarray, Bool[np.ndarray, "height width"]]]) -> float | None:
    """How far hair extends beyond masks, pixels; negative if masks extend beyond the hair, None if that is unknown.

    Args:
        views: pairs of an 8-bit RGB picture and its mask.
    """
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


def with_corrected_masks(capture: Capture, judged: Capture, say: Callable[[str], None]) -> Capture:
    """Grow or shrink a capture's hair masks so that they end where its hair does.

    Args:
        capture: all views.
        judged: the views that may be used to measure the offset.
        say: called with a message if masks are corrected.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    growth = mask_growth(judged)
    if growth == 0:
        return capture
    say(f"{_fault(growth, judged)}; they are {'grown' if growth > 0 else 'shrunk'} by as much")
    return replace(capture, mask_growth=growth / min(_longest_side(judged), LONGEST_SIDE))


def check_border(capture: Capture) -> Finding | None:
    """Report masks that end elsewhere than the hair; None if they do not, or if that is unknown.

    Raises:
        InputError: a photograph or a mask cannot be read.
    """
    growth = mask_growth(capture)
    if growth == 0:
        return None
    action = "fits correct this, but masks that end at the hair's border, or a pixel or two outside it, are better"
    return Finding("mask border", "warning", _fault(growth, capture), action)


def _fault(growth: int, capture: Capture) -> str:
    """Describe the fault of masks that should be grown by `growth` pixels, in pixels of the largest photographs."""
    side = _longest_side(capture)
    pixels = round(abs(growth) * side / min(side, LONGEST_SIDE))
    if growth > 0:
        return f"hair masks end about {pixels} pixels inside the hair"
    return f"hair masks reach about {pixels} pixels too far beyond the hair"


def _longest_side(capture: Capture) -> int:
    return max(max(camera.width, camera.height) for camera in capture.cameras)


def _reduced_view(capture: Capture, index: int) -> tuple[np.ndarray, Float[np.ndarray, "height width"]]:
    picture, mask = capture.image(index).numpy(), capture.hair_mask(index)
    assert mask is not None
    small, coverage = (reduced(each, LONGEST_SIDE) for each in (picture, mask.numpy()))
    return np.rint(np.clip(small, 0, 1) * 255).astype(np.uint8), coverage


def _signed_distance(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
    """Distance to the mask's border, pixels, negative inside."""
    inside = mask.astype(np.uint8)
    outer, inner = (np.asarray(cv2.distanceTransform(each, cv2.DIST_L2, 5)) for each in (1 - inside, inside))
    return outer - inner + np.where(mask, 0.5, -0.5)


def _share_at(like_hair: Sequence[tuple[np.ndarray, np.ndarray]], place: int) -> float | None:
    """Share of pixels at a distance from the border that look like hair, averaged over views; None if too few."""
    bands = [(like, np.abs(distance - place) <= 0.5) for like, distance in like_hair]
    shares = [float(like[band].mean()) for like, band in bands if band.sum() >= FEWEST]
    return sum(shares) / len(shares) if shares else None
