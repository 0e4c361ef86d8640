import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neural_strands.capture.lens import Lens

SIZE = (120, 90)


def lens(*coefficients: float) -> Lens:
    k1, k2, p1, p2, k3 = coefficients
    return Lens((100.0, 104.0, 61.0, 44.5), (k1, k2, p1, p2, k3), *SIZE)


@pytest.mark.parametrize("coefficients", [(0.1, -0.05, 0.002, -0.003, 0.01), (-0.2, 0.03, 0.0, 0.0, 0.0)])
def test_distortion_is_opencvs(coefficients):
    bent = lens(*coefficients)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))
    points[:, 2] += 1.5
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), bent.matrix(), np.array(coefficients))
    np.testing.assert_allclose(bent.distort(points[:, :2] / points[:, 2:]), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("coefficients", [(0.25, 0.0, 0.004, 0.0, 0.0), (-0.25, 0.05, 0.0, 0.003, 0.0)])
def test_a_spot_lands_where_the_pinhole_camera_sees_it(coefficients):
    bent = lens(*coefficients)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    matrix = bent.undistorted_matrix()
    for direction in np.array([[0.2, -0.15], [-0.3, 0.2], [0.0, 0.0], [0.35, 0.25]]):
        x, y = bent.distort(direction)
        photograph = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 8).astype(np.float32)
        undone = bent.undistort(photograph)
        found = (undone * columns).sum() / undone.sum(), (undone * rows).sum() / undone.sum()
        expected = matrix[:2, :2] @ direction + matrix[:2, 2]
        # A blob's centroid moves by a few hundredths of a pixel where magnification changes across it.
        np.testing.assert_allclose(found, expected, atol=0.15)


@pytest.mark.parametrize("coefficients", [(0.25, 0.0, 0.004, 0.0, 0.0), (-0.25, 0.05, 0.0, 0.003, 0.01)])
def test_points_of_the_photograph_come_to_their_places_in_the_undistorted_view(coefficients):
    bent = lens(*coefficients)
    directions = np.random.default_rng(0).uniform(-0.4, 0.4, (40, 2))
    matrix = bent.undistorted_matrix()
    found = bent.undistort_points(bent.distort(directions))
    np.testing.assert_allclose(found, directions @ matrix[:2, :2].T + matrix[:2, 2], atol=1e-6)


def test_a_tall_photograph_is_undistorted_like_its_parts():
    tall = Lens((900.0, 900.0, 10.0, 400.0), (0.1, 0.0, 0.0, 0.0, 0.0), 20, 800)
    rows = np.repeat(np.arange(800, dtype=np.float32)[:, None], 20, axis=1)
    expected = tall.distort(
        np.stack([np.zeros(800), (np.arange(800) + 0.5 - 400) / tall.undistorted_matrix()[1, 1]], 1)
    )
    np.testing.assert_allclose(tall.undistort(rows)[:, 10], np.clip(expected[:, 1] - 0.5, 0, 799), atol=0.1)


@settings(max_examples=30, deadline=None)
@given(k1=st.floats(-0.3, 0.3), p1=st.floats(-0.01, 0.01))
def test_no_pixel_comes_from_outside_the_photograph(k1, p1):
    bent = lens(k1, 0.0, p1, 0.0, 0.0)
    photograph = np.full((SIZE[1], SIZE[0]), 1.0, np.float32)
    zoom = bent.undistorted_zoom()
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    fx, fy, cx, cy = bent.intrinsics
    source = bent.distort(np.stack([(columns - cx) / (fx * zoom), (rows - cy) / (fy * zoom)], axis=-1))
    assert source.min() >= 0
    assert (source <= SIZE).all()
    assert (bent.undistort(photograph) == 1).all()


def test_without_distortion_nothing_is_resampled():
    image = np.random.default_rng(0).random((SIZE[1], SIZE[0], 3)).astype(np.float32)
    straight = lens(0.0, 0.0, 0.0, 0.0, 0.0)
    assert straight.undistort(image) is image
    np.testing.assert_array_equal(straight.undistorted_matrix(), straight.matrix())
