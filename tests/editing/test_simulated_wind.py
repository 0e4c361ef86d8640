"""Simulated wind of whole hair: lengths, the head, determinism, rest, and strands that follow guides."""

import math
from dataclasses import replace

import pytest
import torch
from tiny_hair import RADIUS, tiny_hair_model

from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.hair import Hair
from neural_strands.editing.rods.follow import Followers
from neural_strands.editing.settings import Wind
from neural_strands.editing.simulated_wind import SimulatedHair
from neural_strands.geometry.strands import Strands, segments

BREEZE = Wind()


@pytest.fixture(scope="module")
def hair() -> Hair:
    return Hair.of(tiny_hair_model())


def simulated(hair: Hair, wind: Wind = BREEZE) -> SimulatedHair:
    motion = hair_motion(hair, [replace(wind, simulate=True, guides=40)])
    assert isinstance(motion, SimulatedHair)
    return motion


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0)])
def test_lengths_are_kept_and_strands_stay_out_of_the_head(hair, direction):
    motion = simulated(hair, Wind(direction=direction, strength=4.0))
    rest = segments(hair.strands.points).norm(dim=-1)
    for seconds in (0.0, 0.5, 1.1, 1.9):
        points, guides = motion.at(seconds), motion.guides_at(seconds)
        assert torch.equal(points[:, 0], hair.strands.points[:, 0])
        assert torch.allclose(segments(points).norm(dim=-1), rest, rtol=1e-3)
        assert torch.allclose(segments(guides).norm(dim=-1), motion.rods.length, rtol=1e-3)
        # The ball's faces lie up to 0.2 mm inside its sphere, and the grid blends between nodes.
        if seconds > 1.0:
            assert (points[:, 1:].norm(dim=-1) > RADIUS - 1e-3).all()
            assert (guides[:, 1:].norm(dim=-1) > RADIUS - 1e-3).all()


def test_it_begins_at_rest_moves_and_returns_after_the_wind():
    share = torch.linspace(0, 1, 30)
    roots = torch.arange(20) * 0.004
    points = (
        torch.stack([0 * share, -0.2 * share, 0 * share], dim=1)
        + torch.nn.functional.pad(roots[:, None], (2, 0))[:, None]
    )
    hair = Hair(Strands(points))
    motion = simulated(hair, Wind(strength=1.5, seconds=1.0, calm=2.5))
    assert motion.wind.frames == 84
    assert torch.allclose(motion.at(0.0), points, atol=1e-5)
    assert (motion.at(1.0) - points)[:, -1].norm(dim=-1).min() > 0.03
    assert torch.allclose(motion.at(3.5), points, atol=3e-3)


def test_a_moment_does_not_depend_on_those_before(hair):
    motion = simulated(hair)
    first = motion.at(0.3)
    motion.at(0.4)
    assert torch.equal(motion.at(0.3), first)
    assert torch.equal(simulated(hair).at(0.3), first)
    assert not torch.equal(simulated(hair, Wind(seed=1)).at(0.3), first)


def test_a_frame_is_a_whole_number_of_steps(hair):
    for fps in (24.0, 25.0, 29.97, 240.0):
        steps = 1 / (fps * simulated(Hair(hair.strands), Wind(fps=fps)).seconds_a_step)
        assert steps == pytest.approx(round(steps))


def test_followers_turn_with_their_guides(hair):
    points = hair.strands.points
    followers = Followers.of(points, 40, 12)
    assert torch.allclose(followers.weights.sum(dim=1), torch.ones(len(points)))
    # If all guides rotate alike, so do all strands.
    turn = torch.tensor([0.0, math.sin(0.4), 0.0, math.cos(0.4)])
    alike = followers.turned(turn.repeat(40, 11, 1))
    matrix = torch.tensor([[math.cos(0.8), 0, math.sin(0.8)], [0, 1, 0], [-math.sin(0.8), 0, math.cos(0.8)]])
    assert torch.allclose(alike, followers.steps @ matrix.T, atol=1e-6)
    # Guides with different rotations, compared with the plain torch version.
    small = 0.3 * torch.randn(40, 11, 3, generator=torch.Generator().manual_seed(0))
    turns = torch.nn.functional.normalize(torch.nn.functional.pad(small, (0, 1), value=1.0), dim=-1)
    found = followers.turned(turns)
    assert torch.allclose(found, followers.turned_reference(turns), atol=1e-6)
    assert torch.allclose(found.norm(dim=-1), followers.steps.norm(dim=-1), rtol=1e-5)
    # A guide follows itself alone.
    assert (followers.weights[followers.chosen, 0] == 1).all()
    assert torch.equal(followers.guides[followers.chosen, 0], torch.arange(40))
