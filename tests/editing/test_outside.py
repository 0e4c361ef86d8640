"""Strands kept out of a body, compared with the plain torch version and the formula of a ball."""

import pytest
import torch
from tiny_hair import RADIUS, tiny_hair_model

from neural_strands.editing.hair import Hair
from neural_strands.editing.outside import (
    CLEARANCE,
    LEAST,
    clearance_at,
    follow_outside,
    follow_outside_reference,
    rest_clearance,
)
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.strands import segments


@pytest.fixture(scope="module")
def ball():
    return SignedDistanceGrid.build(tiny_hair_model().body.mesh, 0.005)


def test_steps_that_lead_inside_are_turned(ball):
    strands = Hair.of(tiny_hair_model()).strands
    clearance = torch.full(strands.points.shape[:2], CLEARANCE)
    steps = segments(strands.points)
    # Straight at the centre of the ball, from everywhere.
    into = -torch.nn.functional.normalize(strands.points[:, :1], dim=-1) * steps.norm(dim=-1, keepdim=True)
    for given in (steps, into + 0.3 * steps):
        points = follow_outside(strands.points[:, 0], given, ball, clearance)
        twin = follow_outside_reference(strands.points[:, 0], given, ball, clearance)
        assert torch.allclose(points, twin, atol=1e-4)
        assert torch.allclose(segments(points).norm(dim=-1), given.norm(dim=-1), rtol=1e-3)
        assert (points[:, 1:].norm(dim=-1) > RADIUS - 1e-3).all()


def test_steps_straight_at_the_body_end_above_it(ball, generator):
    outward = torch.nn.functional.normalize(torch.randn(500, 3, generator=generator), dim=1)
    # From 4.5 mm above the surface 5 mm down, exactly or slanting by up to 0.3.
    aside = torch.randn(500, 3, generator=generator) * torch.linspace(0, 0.3, 500)[:, None] ** 4
    steps = 0.005 * torch.nn.functional.normalize(aside - outward, dim=1)[:, None]
    roots = (RADIUS + 0.0045) * outward
    points = follow_outside(roots, steps, ball, torch.full((500, 2), CLEARANCE))
    # The ball's faces lie up to 0.2 mm inside its sphere.
    assert (points[:, 1].norm(dim=1) > RADIUS + CLEARANCE - 2e-4).all()
    assert torch.allclose(segments(points).norm(dim=-1), torch.tensor(0.005), rtol=1e-4)


def test_steps_outside_are_followed_as_they_are(ball):
    strands = Hair.of(tiny_hair_model()).strands
    clearance = rest_clearance(strands.points, ball)
    outside = (ball(strands.points) >= 0).all(dim=1)
    points = follow_outside(strands.points[:, 0], segments(strands.points), ball, clearance)
    assert outside.any()
    assert torch.allclose(points[outside], strands.points[outside], atol=2e-4)
    assert (clearance <= CLEARANCE).all()


def test_points_inside_stay_at_first_and_are_led_out_within_a_second(ball):
    inward = torch.linspace(0, 0.03, 10)
    points = torch.stack([0 * inward, RADIUS - inward, 0 * inward], dim=1)[None].contiguous()
    clearance = rest_clearance(points, ball)
    assert clearance.min() < -0.02
    steps, before = segments(points), points
    for moment in range(41):
        after = follow_outside(points[:, 0], steps, ball, clearance_at(clearance, moment / 20))
        # Without a jump, neither from rest nor on the way.
        assert (after - before).norm(dim=-1).max() < 8e-3
        before = after
    assert torch.allclose(follow_outside(points[:, 0], steps, ball, clearance_at(clearance, 0.0)), points, atol=1e-6)
    # The ball's faces lie up to 0.2 mm inside its sphere.
    assert (before[:, 1:].norm(dim=-1) > RADIUS + LEAST - 3e-4).all()
