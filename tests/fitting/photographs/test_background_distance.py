"""The distance of the background, found from photographs of rooms whose walls are known."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from papered_room import WALL, room, wallpaper

from neural_strands.fitting.photographs.background_distance import (
    FARTHEST,
    NEAREST,
    background_nearness,
    background_shot,
)
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View

CENTRE = torch.tensor([0.0, -0.05, 0.02])
OTHERWISE = 0.1
SIZE = (160, 128)
ROWS = 180


def photographs(count: int, arc: float = 2 * math.pi, moved: float = 0.0) -> list[View]:
    """Pictures of an empty room, taken along a circle towards its middle.

    With `moved`, camera and subject have moved together for each picture, by up to so many metres along each axis.
    """
    random = np.random.default_rng(0)
    papers = [wallpaper(random) for _ in range(6)]
    views = []
    for k in range(count):
        turn = arc * k / count
        eye = torch.tensor([0.7 * math.sin(turn), 0.1 * math.sin(3 * turn), 0.7 * math.cos(turn)])
        camera = Camera.look_at(eye, torch.zeros(3), 150.0, SIZE)
        aside = torch.from_numpy(random.uniform(-moved, moved, 3)).float()
        there = Camera.look_at(eye + aside, aside, 150.0, SIZE)
        views.append(View(camera, torch.from_numpy(room(there, papers) / 255).float()))
    return views


def shots(views: list[View], share: torch.Tensor | None = None):
    share = torch.ones(SIZE[1], SIZE[0]) if share is None else share
    return [background_shot(view, share, ROWS) for view in views]


def seen_directions(views: list[View]) -> torch.Tensor:
    """Directions from the centre to what all pixels show of the walls."""
    places = []
    for view in views:
        rays, eye = view.camera.ray_planes(), view.camera.position[:, None, None]
        places.append(eye + ((WALL * rays.sign() - eye) / rays).amin(dim=0) * rays - CENTRE[:, None, None])
    return torch.cat([place.flatten(1) for place in places], dim=1)


def errors(nearness: torch.Tensor, views: list[View]) -> torch.Tensor:
    """Error of the distances where the photographs show the walls, metres."""
    place = seen_directions(views)
    x, y, z = place / place.norm(dim=0)
    column = ((torch.atan2(x, z) / (2 * math.pi) + 0.5) * 2 * ROWS).long().clamp(max=2 * ROWS - 1)
    row = ((torch.asin(y) / math.pi + 0.5) * ROWS).long().clamp(max=ROWS - 1)
    return (1 / nearness[row, column] - place.norm(dim=0)).abs()


def test_photographs_of_a_room_show_how_far_its_walls_are():
    views = photographs(16)
    found = errors(background_nearness(shots(views), CENTRE, ROWS, OTHERWISE), views)
    assert found.median() < 0.08
    assert found.quantile(0.9) < 0.35


def test_what_is_not_background_does_not_count():
    views = photographs(16)
    share = torch.ones(SIZE[1], SIZE[0])
    share[:, 60:100] = 0.0
    for view in views:
        view.image[:, 60:100] = torch.rand(SIZE[1], 40, 3, generator=torch.Generator().manual_seed(0))
    found = errors(background_nearness(shots(views, share), CENTRE, ROWS, OTHERWISE), views)
    assert found.median() < 0.1


def test_where_nothing_is_seen_distances_go_on_smoothly():
    views = photographs(8, arc=0.8)
    nearness = background_nearness(shots(views), CENTRE, ROWS, OTHERWISE)
    assert errors(nearness, views).median() < 0.15
    steps = torch.cat([(nearness.roll(1, 1) - nearness).abs(), (nearness[1:] - nearness[:-1]).abs()])
    assert steps.max() < 0.1


def test_where_a_person_has_moved_before_the_background_distances_do_not_follow_chance():
    still, moved = (
        background_nearness(shots(photographs(16, 0.6, far)), CENTRE, ROWS, OTHERWISE) for far in (0.0, 0.3)
    )
    assert moved.max() / moved.min() < 1.1
    assert still.max() / still.min() > 1.3


def test_a_plain_wall_is_at_some_distance():
    plain = [replace(view, image=torch.full_like(view.image, 0.6)) for view in photographs(6)]
    nearness = background_nearness(shots(plain), CENTRE, ROWS, OTHERWISE)
    assert ((1 / nearness >= NEAREST - 1e-4) & (1 / nearness <= FARTHEST + 1e-2)).all()


@pytest.mark.parametrize("count", [0, 1])
def test_a_single_photograph_tells_nothing_about_distances(count: int):
    nearness = background_nearness(shots(photographs(count)), CENTRE, ROWS, OTHERWISE)
    assert nearness.shape == (ROWS, 2 * ROWS)
    assert (nearness == OTHERWISE).all()


def test_a_photograph_without_background_has_no_pixels_to_offer():
    (shot,) = shots(photographs(1), torch.full((SIZE[1], SIZE[0]), 0.9))
    assert shot.rays.shape == (3, 1, 0)
    assert shot.colours.shape == (0, 3)
