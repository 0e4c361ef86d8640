"""Quick wind: what it preserves, its direction, and its variation."""

import math
from dataclasses import replace

import pytest
import torch
from tiny_hair import RADIUS, tiny_hair_model

from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import Wind
from neural_strands.editing.wind import BlownHair, turned
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands, segments


@pytest.fixture(scope="module")
def hair() -> Hair:
    return Hair.of(tiny_hair_model())


def hanging(count: int = 5, points: int = 40, length: float = 0.4) -> Strands:
    """Straight strands that hang side by side, 4 mm apart."""
    down = torch.linspace(0, -length, points)
    roots = torch.arange(count) * 0.004
    rows = torch.stack([torch.zeros(count, points), down.expand(count, -1), roots[:, None].expand(-1, points)], dim=2)
    return Strands(rows.contiguous())


def test_segments_turn_by_the_angle_of_weight_and_wind():
    step, mean, towards = (
        torch.tensor([[[0.0, -1.0, 0.0]]]),
        torch.tensor([[0.0, -1.0, 0.0]]),
        torch.tensor([[1.0, 0, 0]]),
    )
    for force in (0.0, 0.5, 1.0, 3.0):
        expected = torch.nn.functional.normalize(torch.tensor([force, -1.0, 0.0]), dim=0)
        assert torch.allclose(turned(step, mean, towards, torch.tensor([[force]]))[0, 0], expected, atol=1e-6)
    # What lies across keeps its place about the axis: here the axis itself.
    aside = turned(torch.tensor([[[0.0, 0.0, 1.0]]]), mean, towards, torch.tensor([[2.0]]))
    assert torch.allclose(aside[0, 0], torch.tensor([0.0, 0.0, 1.0]), atol=1e-6)
    # Hair that already lies along the wind stays, and has no axis.
    along = turned(towards[None], towards, towards, torch.tensor([[2.0]]))
    assert torch.allclose(along[0, 0], towards[0], atol=1e-6)


def test_steady_wind_lifts_tips_by_the_angle_of_its_force():
    blown = BlownHair(Wind(strength=1.0, gusts=0.0), hanging(), None)
    last = segments(blown.at(10.0))[:, -1]
    angle = torch.atan2(last[:, 0], -last[:, 1])
    assert torch.allclose(angle, torch.full((5,), math.pi / 4), atol=1e-3)
    first = segments(blown.at(10.0))[:, 0]
    assert torch.atan2(first[:, 0], -first[:, 1]).abs().max() < 1e-3


def test_lengths_are_kept_and_roots_stay(hair):
    motion = hair_motion(hair, [Wind(direction=(0.0, 0.0, -1.0), strength=3.0)])
    assert motion is not None
    rest = segments(hair.strands.points).norm(dim=-1)
    for seconds in (0.0, 0.4, 2.0):
        points = motion.at(seconds)
        assert torch.equal(points[:, 0], hair.strands.points[:, 0])
        assert torch.allclose(segments(points).norm(dim=-1), rest, rtol=5e-3)


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.3, -1.0)])
def test_strands_never_enter_the_head(hair, direction):
    motion = hair_motion(hair, [Wind(direction=direction, strength=5.0)])
    assert motion is not None
    # What was inside to begin with is led out within a second.
    was_inside = hair.strands.points[:, 1:].norm(dim=-1) < RADIUS
    assert torch.allclose(motion.at(0.0), hair.strands.points, atol=1e-5)
    for seconds in (0.0, 0.6, 1.7, 3.1):
        # The ball's faces lie up to 0.2 mm inside its sphere, and the grid blends between nodes.
        outside = motion.at(seconds)[:, 1:].norm(dim=-1) > RADIUS - 1e-3
        assert (outside | (was_inside & (seconds < 1))).all()


def test_it_begins_at_rest_and_moves_smoothly_in_space_and_time():
    strands = hanging(50)
    blown = BlownHair(Wind(strength=1.0, gusts=1.0), strands, None)
    assert torch.allclose(blown.at(0.0), strands.points, atol=1e-6)
    tips = torch.stack([blown.at(0.6 + k / 60)[:, -1] for k in range(60)])
    between_frames = (tips[1:] - tips[:-1]).norm(dim=-1)
    between_strands = (tips[:, 1:] - tips[:, :-1]).norm(dim=-1)
    assert between_frames.max() < 0.03
    assert between_strands.max() < 0.03
    # But the hair does move.
    assert (tips.amax(dim=0) - tips.amin(dim=0)).norm(dim=-1).min() > 0.03


def test_seeds():
    strands = hanging()
    first, second, other = (BlownHair(Wind(seed=seed), strands, None).at(1.0) for seed in (0, 0, 1))
    assert torch.equal(first, second)
    assert not torch.equal(first, other)


def test_of_several_winds_the_last_one_blows(hair):
    still = replace(hair, model=None, body=None)
    motion = hair_motion(still, [Wind(strength=1.0), Wind(strength=2.0, seconds=0.5, fps=10.0)])
    assert motion is not None
    assert motion.wind.strength == 2.0
    assert motion.wind.frames == 5
    assert hair_motion(hair, []) is None


def test_a_model_without_a_body_has_no_grid():
    model = tiny_hair_model()
    hair = Hair.of(model)
    assert hair.body_grid is not None
    assert replace(hair, strands=hair.strands.select(torch.arange(2))).body_grid is hair.body_grid
    model.body.faces = model.body.faces[:0]
    assert Hair.of(model).body_grid is None


def test_a_direction_needs_a_length():
    with pytest.raises(InputError, match="wind: expected a direction with a length"):
        Wind(direction=(0.0, 0.0, 0.0))
