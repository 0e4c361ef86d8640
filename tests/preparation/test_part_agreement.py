"""Parts of a hair mask are judged by the other views: a ball as head, smaller balls as hair on both sides of it."""

import math

import numpy as np
import pytest
import torch
import trimesh

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.preparation.masks.agreement import Agreement
from neural_strands.preparation.masks.finish import HAIR, NOT_HAIR

HEAD, LOCK = 0.1, 0.025
"""Radius of the head and of a lock, metres."""
LOCKS = torch.tensor([[-0.14, 0.0, 0.0], [0.14, 0.0, 0.0]])
VIEWS, SIDE = 12, 120
LEFT, RIGHT, BEARD, WALL = 1, 2, 3, 4


def ring() -> list[Camera]:
    turns = [2 * math.pi * number / VIEWS for number in range(VIEWS)]
    eyes = [torch.tensor([math.sin(turn), 0.2, math.cos(turn)]) for turn in turns]
    return [Camera.look_at(eye, torch.zeros(3), 250.0, (SIDE, SIDE), f"{number}") for number, eye in enumerate(eyes)]


def distance(camera: Camera, centre: torch.Tensor, radius: float) -> torch.Tensor:
    """Distance to a ball along each pixel's ray; infinite where it is missed."""
    rays, offset = camera.rays(camera.pixel_centres()), camera.position - centre
    along = -(rays @ offset)
    inside = along**2 - (offset @ offset - radius**2)
    return torch.where(inside > 0, along - inside.clamp(min=0).sqrt(), torch.full_like(along, math.inf))


def locks_seen(camera: Camera) -> list[np.ndarray]:
    head = distance(camera, torch.zeros(3), HEAD)
    return [(distance(camera, lock, LOCK) < head).numpy() for lock in LOCKS]


def parts_of(camera: Camera) -> np.ndarray:
    """Names of the parts in a picture from the front: both locks, a beard, and a strip of the wall."""
    names = np.zeros((SIDE, SIDE), np.int64)
    for name, lock in zip((LEFT, RIGHT), locks_seen(camera), strict=True):
        names[lock] = name
    names[66:78, 54:66] = BEARD
    names[10:30, 100:106] = WALL
    return names


def judged(missed_by: tuple[int, ...]) -> np.ndarray:
    """Shares for the first view, whose mask and some other views' masks miss the left lock."""
    ball = trimesh.creation.icosphere(4, HEAD)
    head = Mesh(torch.from_numpy(ball.vertices).float(), torch.from_numpy(ball.faces))
    cameras, masks = ring(), []
    for number, camera in enumerate(cameras):
        left, right = locks_seen(camera)
        masks.append(right if number == 0 or number in missed_by else left | right)
    names = np.array([LEFT, RIGHT, BEARD, WALL])
    return Agreement.of(cameras, masks, head).shares(0, parts_of(cameras[0]), names)


@pytest.mark.parametrize("missed_by", [(), (11,), (1, 2)])
def test_hair_that_others_show_is_hair(missed_by: tuple[int, ...]):
    """View 11 sees the left lock; the head hides it from view 2, whose mask says nothing about it."""
    shares = judged(missed_by)
    assert (shares[:2] >= HAIR).all()
    assert (shares[2:] <= NOT_HAIR).all()


def test_a_place_that_two_others_see_through_is_not_hair():
    shares = judged((10, 11))
    assert shares[0] <= NOT_HAIR
    assert shares[1] >= HAIR


def test_without_parts_nothing_is_judged():
    ball = trimesh.creation.icosphere(2, HEAD)
    head = Mesh(torch.from_numpy(ball.vertices).float(), torch.from_numpy(ball.faces))
    cameras = ring()
    agreement = Agreement.of(cameras, [np.zeros((SIDE, SIDE), bool)] * VIEWS, head)
    assert agreement.shares(0, parts_of(cameras[0]), np.zeros(0, np.int64)).shape == (0,)
