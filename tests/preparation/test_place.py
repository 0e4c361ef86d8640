"""Placing a template: a known similarity comes back, and the world's cameras see the same pictures."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from synthetic_face import arc, face_points, images_of

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import TorsoMotion
from neural_strands.preparation.face.triangulate import triangulate_face
from neural_strands.preparation.head.place import cameras_in_world, place, world_frame
from neural_strands.preparation.head.template import Template
from neural_strands.scalp.fit_similarity import Similarity
from neural_strands.scalp.mannequin import mannequin


def template(points: np.ndarray) -> Template:
    marks = torch.from_numpy(points).float()
    return Template(mannequin(), marks, torch.zeros(len(marks)))


def turned() -> Similarity:
    angle = 0.4
    rotation = torch.tensor(
        [[math.cos(angle), -math.sin(angle), 0.0], [math.sin(angle), math.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    ).double()
    return Similarity(1.1, rotation, torch.tensor([0.02, -0.03, 0.01]).double())


def test_a_known_similarity_comes_back_among_slipped_landmarks():
    true, points, cameras = turned(), face_points(), arc()
    moved = true.apply(torch.from_numpy(points)).numpy()
    face = triangulate_face(cameras, images_of(moved, cameras))
    slipped = points.copy()
    slipped[::6] += 0.02
    fit = place(template(slipped), face)
    assert fit.fit.scale == pytest.approx(1.1, rel=2e-3)
    assert torch.allclose(fit.fit.rotation, true.rotation, atol=3e-3)
    assert torch.allclose(fit.fit.translation, true.translation, atol=5e-4)
    assert fit.residual < 1e-3


def test_cameras_see_the_same_after_the_world_is_moved():
    true, cameras = turned(), arc(3)
    points = torch.from_numpy(face_points()).double()
    for before, after in zip(cameras, cameras_in_world(cameras, true), strict=True):
        here, depth = before.project(points.float())
        there, scaled = after.project(true.apply(points).float())
        torch.testing.assert_close(here, there, atol=2e-2, rtol=0)
        torch.testing.assert_close(1.1 * depth, scaled, atol=1e-4, rtol=1e-4)


def test_the_world_has_the_templates_axes_and_the_given_metre():
    true, points, cameras = turned(), face_points(), arc()
    moved = true.apply(torch.from_numpy(points))
    fit = place(template(points), triangulate_face(cameras, images_of(moved.numpy(), cameras)))
    frame = world_frame(fit, 2.0)
    # A template of one metre became 1.1 units; a unit is two metres.
    expected = 2.2 * torch.from_numpy(points)
    torch.testing.assert_close(frame.apply(moved), expected, atol=2e-3, rtol=0)


def test_too_few_landmarks_are_refused():
    points, cameras = face_points(), arc()
    face = triangulate_face(cameras, images_of(points, cameras))
    bare = np.full_like(points, np.nan)
    bare[:5] = points[:5]
    with pytest.raises(InputError, match="at least 8 landmarks"):
        place(template(bare), face)


def test_room_and_torso_stay_where_they_are_after_the_world_is_moved():
    true, random = turned(), torch.Generator().manual_seed(0)
    motion = torch.eye(4)
    motion[:3, :3] = turned().rotation.float().T
    motion[:3, 3] = torch.tensor([0.05, 0.02, -0.03])
    torso = TorsoMotion(motion, torch.tensor([[0.0, -0.1, 0.0], [0.02, -0.5, 0.1]]))
    cameras = [replace(camera, world_to_room=motion, torso=torso) for camera in arc(3)]
    points = torch.randn(20, 3, generator=random)
    in_world = true.apply(points.double()).float()
    for before, after in zip(cameras, cameras_in_world(cameras, true), strict=True):
        here, _ = before.in_room().project(points)
        there, _ = after.in_room().project(in_world)
        torch.testing.assert_close(here, there, atol=2e-2, rtol=1e-4)
        assert after.torso is not None
        here, _ = before.project(torso.moved(points))
        there, _ = after.project(after.torso.moved(in_world))
        torch.testing.assert_close(here, there, atol=2e-2, rtol=1e-4)
