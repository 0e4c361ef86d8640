"""Offsets between masks and hair, on drawn pictures whose hair is known."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from neural_strands.capture.capture import Capture, grown
from neural_strands.capture.mask_border import (
    TIGHT,
    border_of,
    check_border,
    growth_of,
    mask_growth,
    needed_growth,
    with_corrected_masks,
)
from neural_strands.capture.writer import CaptureWriter
from neural_strands.geometry.cameras import Camera

SIDE = 160


def picture(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Brown streaks in a disc on a noisy grey wall, and where the disc is."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:SIDE, :SIDE]
    middle = SIDE / 2 + random.uniform(-8, 8, 2)
    hair = np.hypot(x - middle[0], y - middle[1]) < 48
    streaks = 60 + 25 * np.sin(0.9 * x + 0.3 * y) + 8 * random.standard_normal((SIDE, SIDE))
    wall = 150 + 4 * random.standard_normal((SIDE, SIDE))
    colour = np.where(hair[..., None], streaks[..., None] * [1.0, 0.7, 0.5], wall[..., None])
    return colour.clip(0, 255).astype(np.uint8), hair


def resized(mask: np.ndarray, pixels: int) -> np.ndarray:
    return grown(mask.astype(np.uint8), pixels) > 0


@pytest.mark.parametrize("off", [-6, -4, -2, 0, 2, 4])
def test_the_border_is_found_to_a_pixel(off: int):
    views = [(image, resized(hair, off)) for image, hair in map(picture, range(5))]
    border = border_of(views)
    assert border is not None
    assert abs(border + off) < 1.0


def test_hair_that_looks_like_the_wall_tells_nothing():
    random = np.random.default_rng(0)
    wall = (100 + 10 * random.standard_normal((SIDE, SIDE, 3))).clip(0, 255).astype(np.uint8)
    assert border_of([(wall, picture(0)[1])]) is None


def test_empty_full_and_tiny_masks_tell_nothing():
    image, _ = picture(0)
    dot = np.zeros((SIDE, SIDE), dtype=bool)
    dot[80:84, 80:84] = True
    for mask in (np.zeros_like(dot), np.ones_like(dot), dot):
        assert border_of([(image, mask)]) is None
    assert border_of([]) is None


@pytest.mark.parametrize(
    ("border", "faint", "growth"),
    [
        *[(None, None, 0), (0.0, None, 0), (1.4, 4.0, 0), (1.6, 2.0, 2), (4.2, 3.0, 4)],
        *[(1.6, 1.8, 0), (4.2, 1.8, 0), (4.2, None, 0)],
        *[(-1.5, None, 0), (-2.4, None, 0), (-3.2, None, -2), (-5.0, None, -4)],
    ],
)
def test_a_border_of_a_pixel_or_two_is_left(border: float | None, faint: float | None, growth: int):
    assert needed_growth(border, faint) == growth


@pytest.mark.parametrize("off", [-6, -4, -1, 0, 1, 4])
def test_masks_are_grown_to_the_hair(off: int):
    views = [(image, resized(hair, off).astype(float)) for image, hair in map(picture, range(5))]
    border = border_of([(image, mask > 0) for image, mask in views])
    # Masks without faint coverage end at the same place at every value.
    assert growth_of(views) == needed_growth(border, border)
    assert (growth_of(views) == 0) == (abs(off) < 2)


def sparse(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Hair that lets bright skin through and thins out over 12 pixels towards its border, and its matte.

    Deep hair with skin behind it can look like the border with the wall behind it, a third of which is covered.
    """
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:SIDE, :SIDE]
    radius = np.hypot(x - SIDE / 2, y - SIDE / 2)
    inside = 0.775 + 0.225 * np.sin(0.4 * x + 0.2 * y)
    matte = np.where(radius < 40, inside, ((52 - radius) / 12).clip(0, 1))
    hair = 60 + 4 * random.standard_normal((SIDE, SIDE))
    behind = np.where(radius < 40, 220, 190) + 4 * random.standard_normal((SIDE, SIDE))
    colour = (matte * hair + (1 - matte) * behind)[..., None] * [1.0, 0.7, 0.5]
    return colour.clip(0, 255).astype(np.uint8), (255 * matte).round().astype(np.uint8)


def test_mattes_of_sparse_hair_are_not_too_tight():
    views = [sparse(seed) for seed in range(5)]
    border = border_of([(image, matte > 127) for image, matte in views])
    assert border is not None
    assert border > TIGHT
    assert growth_of([(image, matte / 255) for image, matte in views]) == 0
    # Hair goes on beyond faint coverage, too, where such mattes are eroded.
    assert growth_of([(image, grown(matte, -4) / 255) for image, matte in views]) > 2


def test_grown_masks_reach_by_a_disc():
    dot = np.zeros((21, 21), np.uint8)
    dot[10, 10] = 255
    y, x = np.mgrid[-10:11, -10:11]
    large = grown(dot, 4) > 0
    assert (large[np.hypot(x, y) <= 3.5]).all()
    assert not large[np.hypot(x, y) > 4.5].any()
    np.testing.assert_array_equal(grown(grown(dot, 4), -4), dot)
    assert grown(dot, 0) is dot


def write(folder: Path, off: int) -> Capture:
    writer, cameras = CaptureWriter(folder), []
    for index in range(4):
        angle = torch.tensor(0.4 * index)
        eye = torch.stack([angle.sin(), torch.tensor(0.1), angle.cos()])
        camera = Camera.look_at(eye, torch.zeros(3), 300.0, (SIDE, SIDE), f"{index}.png")
        image, hair = picture(index)
        mask = resized(hair, off).astype(np.uint8) * 255
        writer.write_view(camera, image, mask)
        cameras.append(camera)
    writer.finish(cameras)
    return Capture.load(folder)


def test_a_capture_is_corrected_and_its_file_is_not(tmp_path: Path):
    capture = write(tmp_path / "tight", -5)
    said: list[str] = []
    corrected = with_corrected_masks(capture, capture.subset([0, 1, 2]), said.append)
    assert round(corrected.mask_growth * SIDE) in (4, 5, 6)
    assert "inside the hair" in said[0]
    # Photographs that were not examined are corrected by the same amount.
    mask, true = corrected.hair_mask(3), picture(3)[1]
    assert mask is not None
    wrong = (mask.numpy() > 0.5) ^ true
    assert wrong.sum() < 0.2 * (true ^ resized(true, -5)).sum()
    original = capture.hair_mask(3)
    assert original is not None
    assert original.sum() < mask.sum()
    assert corrected.subset([3]).mask_growth == corrected.mask_growth
    found = check_border(capture)
    assert found is not None
    assert found.level == "warning"


def test_right_masks_and_captures_without_masks_stay(tmp_path: Path):
    capture = write(tmp_path / "right", 0)
    said: list[str] = []
    assert with_corrected_masks(capture, capture, said.append) is capture
    assert not said
    assert check_border(capture) is None
    bare = replace(capture, files=tuple(replace(view, hair_mask_path=None) for view in capture.files))
    assert mask_growth(bare) == 0


@pytest.mark.parametrize("off", [-4, 0, 4])
def test_mattes_that_are_off_are_found(off: int, shared_data: Path):
    """Soft masks, as a matting program makes them: eroded, they are partly covered nearly everywhere."""
    capture = Capture.load(shared_data / "captures" / "sintel_bob")
    side = max(capture.cameras[0].width, capture.cameras[0].height)
    capture = replace(capture, mask_growth=off / side)
    some = [(capture.image(index), capture.hair_mask(index)) for index in range(0, len(capture), 4)]
    views = [((255 * image).round().byte().numpy(), mask.numpy() > 0.5) for image, mask in some if mask is not None]
    border = border_of(views)
    assert border is not None
    assert abs(border + off) < 1.0
    assert mask_growth(capture) in {-4: (3, 4, 5), 0: (0,), 4: (-4, -3, -2)}[off]


def test_large_pictures_are_looked_at_smaller(tmp_path: Path):
    image, hair = picture(0)
    size, off = (10 * SIDE, 10 * SIDE), 6
    # 6 pixels in a picture of 1024 pixels are 9 in one of 1600.
    large = cv2.resize(image, size, interpolation=cv2.INTER_LINEAR)
    true = cv2.resize(hair.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    mask = 255 * grown(true, -round(off * 10 * SIDE / 1024))
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 3000.0, size, "0.png")
    writer = CaptureWriter(tmp_path)
    writer.write_view(camera, large, mask)
    writer.finish([camera])
    capture = Capture.load(tmp_path)
    assert mask_growth(capture) in (off - 1, off, off + 1)
    corrected = with_corrected_masks(capture, capture, lambda _: None).hair_mask(0)
    assert corrected is not None
    wrong = ((corrected.numpy() > 0.5) ^ (true > 0)).sum()
    assert wrong < 0.35 * ((mask > 0) ^ (true > 0)).sum()
