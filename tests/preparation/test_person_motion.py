"""Cameras follow what moves between photographs, and stay where nothing does."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.cameras.motion import Expected, Motion, Tracks, find_motion
from neural_strands.preparation.face.triangulate import project, projection_matrices, triangulate

CAMERAS, POINTS, UNIT = 24, 300, 0.07
"""Cameras around a head, points on it, and metres per unit of their frame."""
EXPECTED = Expected(np.radians(0.3), 0.001 / UNIT)


def ring() -> list[Camera]:
    cameras = []
    for number in range(CAMERAS):
        turn = 2 * np.pi * number / CAMERAS
        eye = torch.tensor([np.sin(turn), 0.1 * (number % 3), np.cos(turn)]).float() * 0.8 / UNIT
        cameras.append(Camera.look_at(eye, torch.zeros(3), 540.0, (512, 512), f"{number}"))
    return cameras


def photographed(degrees: float, metres: float) -> tuple[list[Camera], Tracks, Motion]:
    """Cameras in a room, what they see of a head that moves, and its true motion: a slow sway without a mean."""
    random = np.random.default_rng(0)
    phase = 2 * np.pi * np.arange(CAMERAS)[:, None] / CAMERAS * np.array([2, 3, 4]) + random.uniform(0, 6, 3)
    turn, shift = np.radians(degrees) * np.sin(phase), metres / UNIT * np.cos(phase)
    direction = random.normal(size=(POINTS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # From above and from below, no camera sees anything.
    direction = direction[abs(direction[:, 1]) < 0.7]
    position = 0.1 / UNIT * direction
    truth = Motion(turn, shift, position, np.zeros(3))
    cameras = ring()
    rows = []
    for number, camera in enumerate(truth.followed(cameras)):
        pixel, _ = camera.project(torch.from_numpy(position).float())
        towards = torch.nn.functional.normalize(camera.position, dim=0).double().numpy()
        seen = np.flatnonzero(direction @ towards > 0.4)
        rows.append((np.full(len(seen), number), seen, pixel.double().numpy()[seen]))
    camera, point, pixel = (np.concatenate(part) for part in zip(*rows, strict=True))
    pixel = pixel + random.normal(0, 0.4, pixel.shape)
    wrong = random.random(len(pixel)) < 0.05
    pixel[wrong] += random.normal(0, 15, (wrong.sum(), 2))
    start = position + random.normal(0, 0.002 / UNIT, position.shape)
    return cameras, Tracks(start, camera, point, pixel), truth


def disagreement(cameras: Sequence[Camera], truth: Motion) -> float:
    """Median reprojection error, pixels, of other points, on hair 2 cm above the head, that the cameras triangulate."""
    random = np.random.default_rng(1)
    direction = random.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    true = truth.followed(ring())
    hair = torch.from_numpy(0.12 / UNIT * direction).float()
    pixels = np.stack([camera.project(hair)[0].double().numpy() for camera in true])
    towards = np.stack([torch.nn.functional.normalize(camera.position, dim=0).double().numpy() for camera in true])
    shown = (towards @ direction.T > 0.4).astype(float)
    projections = projection_matrices(cameras)
    found = triangulate(projections, pixels, shown)
    error = np.linalg.norm(project(projections, found)[0] - pixels, axis=-1)
    return float(np.median(error[(shown > 0) & np.isfinite(error)]))


@pytest.mark.parametrize("metres", [0.002, 0.004])
def test_cameras_that_follow_agree_about_the_hair(metres: float):
    cameras, tracks, truth = photographed(0.6, metres)
    found = find_motion(cameras, tracks, np.zeros(3), EXPECTED)
    assert disagreement(cameras, truth) > 1.0
    assert disagreement(found.followed(cameras), truth) < 0.25 * disagreement(cameras, truth)


def test_a_head_that_stands_still_stays():
    cameras, tracks, truth = photographed(0.0, 0.0)
    found = find_motion(cameras, tracks, np.zeros(3), EXPECTED)
    assert np.degrees(Rotation.from_rotvec(found.turn).magnitude()).max() < 0.15
    assert 1000 * UNIT * np.linalg.norm(found.shift, axis=1).max() < 0.5
    assert disagreement(found.followed(cameras), truth) < 0.15
    apart = 1000 * UNIT * np.linalg.norm(found.position - truth.position, axis=1)
    assert np.median(apart) < 0.6


def test_cameras_that_see_no_point_stay():
    cameras, tracks, _ = photographed(0.6, 0.002)
    kept = tracks.camera > 0
    partly = Tracks(tracks.position, tracks.camera[kept], tracks.point[kept], tracks.pixel[kept])
    found = find_motion(cameras, partly, np.zeros(3), EXPECTED)
    assert np.allclose(found.turn[0], 0)
    assert np.allclose(found.shift[0], 0)


def test_its_size_is_that_of_its_transforms():
    _, _, truth = photographed(0.6, 0.002)
    turn, shift = truth.size()
    transforms = truth.transforms().numpy()
    turns = Rotation.from_matrix(transforms[:, :3, :3]).magnitude()
    assert np.isclose(np.radians(turn), np.sqrt((turns**2).mean()))
    middles = transforms[:, :3, :3] @ truth.middle + transforms[:, :3, 3]
    assert np.isclose(shift, np.sqrt(((middles - truth.middle) ** 2).sum(axis=1).mean()))
