import cv2
import numpy as np
import pytest
import torch

from neural_strands.geometry.cameras import Camera, pinhole
from neural_strands.viewer.frames import seen_by, wiped


def camera(focal, size):
    return Camera(pinhole(focal, size), torch.eye(4), *size)


def test_a_photograph_seen_by_its_own_camera_is_itself():
    photograph = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)
    own = camera(40.0, (32, 24))
    np.testing.assert_array_equal(seen_by(photograph, own, own, np.zeros_like(photograph)), photograph)


@pytest.mark.parametrize("factor", [0.5, 2.0, 3.0])
def test_a_photograph_keeps_its_rays(factor):
    """A smooth picture sampled along the rays of the other camera, each pixel by itself, is the oracle."""
    taken, other = camera(40.0, (32, 24)), camera(40.0 * factor, (int(30 * factor), int(40 * factor)))
    x, y = np.meshgrid(np.arange(32) + 0.5, np.arange(24) + 0.5)
    photograph = np.stack([40 + 5 * x, 30 + 6 * y, 20 + 2 * x + 3 * y], axis=2).round().astype(np.uint8)
    behind = np.full((other.height, other.width, 3), 7, np.uint8)
    seen = seen_by(photograph, taken, other, behind)
    pixels, _ = taken.project(other.unproject(other.pixel_centres(), torch.ones(other.height, other.width)))
    u, v = pixels[..., 0].numpy(), pixels[..., 1].numpy()
    expected = np.stack([40 + 5 * u, 30 + 6 * v, 20 + 2 * u + 3 * v], axis=2)
    inside = (u > 2) & (u < 30) & (v > 2) & (v < 22)
    assert np.abs(seen[inside] - expected[inside]).max() < 3
    outside = (v < -0.5) | (v > 24.5)
    assert outside.any()
    assert (seen[outside] == 7).all()


def test_shrinking_averages_instead_of_skipping():
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[:, ::2] = 255
    small = seen_by(stripes, camera(80.0, (64, 64)), camera(20.0, (16, 16)), np.zeros((16, 16, 3), np.uint8))
    assert small[4:12, 4:12].std() < 12
    assert abs(float(small[4:12, 4:12].mean()) - cv2.resize(stripes, (16, 16), interpolation=cv2.INTER_AREA).mean()) < 8


@pytest.mark.parametrize(("share", "left"), [(0.0, 0), (0.25, 10), (1.0, 40)])
def test_the_wipe_shows_each_picture_on_its_side(share, left):
    ours, theirs = np.full((8, 40, 3), 10, np.uint8), np.full((8, 40, 3), 90, np.uint8)
    picture = wiped(theirs, ours, share)
    assert (picture[:, : max(left - 1, 0)] == 90).all()
    assert (picture[:, left:] == 10).all()
    line = (picture == 255).all(axis=(0, 2)).sum()
    assert line == (1 if 0 < left < 40 else 0)
