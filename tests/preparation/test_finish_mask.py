"""Which parts of what looks like hair become the mask."""

import cv2
import numpy as np
import pytest

from neural_strands.flow.hull import HullConfig
from neural_strands.preparation.masks.finish import MARGIN, parts_of_hair, soft_mask

FOOTPRINT = 0.001
"""One millimetre per pixel, so that the figures below are in millimetres."""
CHIN = 150


def finished(parts: np.ndarray, likely: float = 0.3, agreed: float | None = None) -> np.ndarray:
    below = np.arange(len(parts))[:, None] >= CHIN
    prior = np.full(parts.shape, likely)

    def shares(_: np.ndarray, names: np.ndarray) -> np.ndarray:
        return np.full(len(names), agreed)

    judge = None if agreed is None else shares
    hair = parts_of_hair(parts.astype(np.float64), prior, below & np.ones_like(parts), FOOTPRINT, judge)
    return soft_mask(hair, parts.shape[::-1])


def drawn(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    """Boxes as top, bottom, left, right."""
    parts = np.zeros((300, 240), dtype=bool)
    for top, bottom, left, right in boxes:
        parts[top:bottom, left:right] = True
    return parts


def test_above_one_half_a_mask_is_the_hair_and_a_margin_has_less():
    parts = drawn((30, 140, 60, 180))
    mask = finished(parts) / 255
    away = cv2.distanceTransform((~parts).astype(np.uint8), cv2.DIST_L2, 5)
    assert (mask[parts] == 1).all()
    assert (mask[~parts] < 0.5).all()
    assert (mask[away > MARGIN + 0.5] == 0).all()
    # 0.5 at the border of the hair, which is half a pixel away from the middle of the first pixel, and 0 at 3 pixels.
    assert np.allclose(mask[85, 180:184], [2.5 / 6, 1.5 / 6, 0.5 / 6, 0], atol=0.01)


def test_two_pixels_of_the_margin_are_room_for_hair():
    mask = finished(drawn((30, 140, 60, 180))) / 255
    assert (mask[85, 180:183] >= HullConfig().mask_threshold).tolist() == [True, True, False]


def test_long_hair_goes_on_below_the_chin():
    parts = drawn((30, 140, 60, 180), (100, 290, 60, 90), (100, 290, 150, 180))
    assert (finished(parts)[parts] == 255).all()


def test_a_collar_that_hangs_by_a_thin_shadow_is_dropped():
    hair, bridge, collar = drawn((30, 140, 60, 180)), drawn((140, 200, 60, 70)), drawn((200, 206, 60, 180))
    mask = finished(hair | bridge | collar) > 0
    assert mask[hair].all()
    assert not mask[collar].any()
    # The bridge counts as hair above the chin, and below it as far as a wisp may reach.
    assert mask[145:160, 62:68].all()
    assert not mask[170:200].any()


def test_thin_locks_above_the_chin_are_kept():
    parts = drawn((30, 140, 60, 180), (80, 84, 180, 230))
    assert (finished(parts)[parts] == 255).all()


@pytest.mark.parametrize(("likely", "kept"), [(0.3, False), (0.8, True)])
def test_a_small_part_of_its_own_stays_only_where_hair_is_likely(likely: float, kept: bool):
    hair, part = drawn((30, 140, 60, 180)), drawn((40, 60, 200, 220))
    assert bool((finished(hair | part, likely)[part] == 255).all()) == kept


def test_a_small_part_below_the_chin_is_never_hair():
    hair, part = drawn((30, 140, 60, 180)), drawn((200, 240, 200, 230))
    mask = finished(hair | part, likely=0.9)
    assert (mask[hair] == 255).all()
    assert not mask[part].any()


@pytest.mark.parametrize(
    ("agreed", "likely", "kept"), [(0.8, 0.1, True), (0.1, 0.9, False), (0.45, 0.1, False), (0.45, 0.9, True)]
)
def test_what_other_views_agree_on_decides(agreed: float, likely: float, kept: bool):
    hair, part = drawn((30, 140, 60, 180)), drawn((40, 60, 200, 220))
    mask = finished(hair | part, likely, agreed)
    assert (mask[hair] == 255).all()
    assert bool((mask[part] == 255).all()) == kept


def test_a_lock_of_its_own_below_the_chin_is_hair_if_others_agree():
    hair, part = drawn((30, 140, 60, 180)), drawn((200, 240, 200, 230))
    assert (finished(hair | part, agreed=0.8)[part] == 255).all()


def test_no_hair_is_an_empty_mask():
    assert not finished(drawn()).any()
