"""The texture of drawn hair whose course, slope and pitch are known."""

import math
from dataclasses import replace

import pytest
import torch

from neural_strands.fitting.curls.streaks import BINS, LAGS, Course, Texture, course_of, drawn_hair, texture_of
from neural_strands.flow.curls import Curl, Locks, curled
from neural_strands.geometry.cameras import Camera
from neural_strands.lmvs.orientation import OrientationConfig

SIDE = 256
CAMERA = Camera.look_at(torch.tensor([0.0, 0.0, 0.6]), torch.zeros(3), 600.0, (SIDE, SIDE), "front")
FILTERS = OrientationConfig()


def curtain(tilt: float = 0.0, count: int = 3000) -> torch.Tensor:
    """Strands that hang in a layer 1 cm thick, 26 cm wide; tilted counter-clockwise as the camera sees it, radians."""
    random = torch.Generator().manual_seed(0)
    start = (torch.rand(count, 1, 3, generator=random) - 0.5) * torch.tensor([0.36, 0.05, 0.01])
    start = start + torch.tensor([0.0, 0.18, 0.0])
    points = start + 0.36 * torch.linspace(0, 1, 120)[None, :, None] * torch.tensor([0.0, -1.0, 0.0])
    cosine, sine = math.cos(tilt), math.sin(tilt)
    return points @ torch.tensor([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def one_phase(count: int) -> Locks:
    """All strands in one phase."""
    return Locks(torch.zeros(count), torch.ones(count))


def texture(strands: torch.Tensor, course: Course) -> Texture:
    picture = drawn_hair(strands, CAMERA, torch.Generator().manual_seed(1))
    return texture_of([picture], [torch.ones(SIDE, SIDE)], [course], [CAMERA], FILTERS)


def leans(found: Texture) -> torch.Tensor:
    return torch.linspace(-90 + 90 / BINS, 90 - 90 / BINS, BINS)


@pytest.fixture(scope="module")
def course() -> Course:
    return course_of(curtain(), CAMERA)


@pytest.mark.parametrize("tilt", [0.0, 0.4, -1.0])
def test_the_course_is_the_projected_direction(tilt):
    found = course_of(curtain(tilt), CAMERA)
    middle = slice(80, 176)
    assert found.known[middle, middle].float().mean() > 0.99
    # Image axes: y points down, so a counter-clockwise turn lowers the angle.
    off = (found.angle[middle, middle] - (math.pi / 2 - tilt) + math.pi / 2).remainder(math.pi) - math.pi / 2
    assert off.abs().max() < 0.02
    assert (found.depth[middle, middle] - 0.6).abs().max() < 0.02


def test_straight_hair_does_not_lean(course):
    found = texture(curtain(), course)
    assert found.lean.sum() == pytest.approx(1, abs=1e-5)
    assert found.lean[leans(found).abs() < 10].sum() > 0.9


def test_tilted_hair_leans_by_its_tilt(course):
    found = texture(curtain(math.radians(30)), course)
    assert found.lean[(leans(found) + 30).abs() < 8].sum() > 0.8


@pytest.mark.parametrize("turn", [1, -1])
def test_curls_lean_to_the_side_that_their_handedness_gives(course, turn):
    curl = Curl(0.006, 0.03, turn)
    axes = curtain()
    found = texture(
        curled(axes, torch.tensor([0.0, 0.0, 1.0]).expand(len(axes), 3), one_phase(len(axes)), curl), course
    )
    side = leans(found) * turn > 0
    assert found.lean[side].sum() > 0.75
    assert float(leans(found)[found.lean.argmax()]) * turn == pytest.approx(math.degrees(math.atan(curl.slope)), abs=12)


@pytest.mark.parametrize("pitch", [0.02, 0.032])
def test_curls_repeat_after_their_pitch(course, pitch):
    axes = curtain()
    curl = Curl(0.005, pitch, 1)
    found = texture(
        curled(axes, torch.tensor([0.0, 0.0, 1.0]).expand(len(axes), 3), one_phase(len(axes)), curl), course
    )
    lags = torch.tensor(LAGS)
    near = (lags > 0.6 * pitch) & (lags < 1.4 * pitch)
    best = lags[near][found.repetition[near].argmax()]
    assert float(best) == pytest.approx(pitch, abs=0.0035)


def test_the_course_is_unknown_where_there_is_no_hair():
    strands = curtain()
    found = course_of(strands[strands[:, 0, 0] < -0.01], CAMERA)
    assert found.known[:, :100].float().mean() > 0.9
    assert not found.known[:, 140:].any()


def test_the_same_texture_does_not_differ(course):
    axes = curtain()
    normals, locks = torch.tensor([0.0, 0.0, 1.0]).expand(len(axes), 3), one_phase(len(axes))
    fine, coarse = (
        texture(curled(axes, normals, locks, Curl(0.2 * pitch, pitch, 1)), course) for pitch in (0.02, 0.035)
    )
    assert fine.difference(fine, 1.0) == pytest.approx(0, abs=1e-6)
    assert fine.difference(coarse, 1.0) == pytest.approx(coarse.difference(fine, 1.0), abs=1e-6)
    assert fine.difference(coarse, 1.0) > 0.5
    assert fine.difference(coarse, 0.0) == fine.lean_difference(coarse)
    assert fine.lean_difference(coarse) < 0.2
    assert fine.lean_difference(texture(axes, course)) > 0.6


def test_how_far_locks_look_alike_and_how_regular_turns_are_does_not_count():
    lags = torch.tensor(LAGS)

    def repeating(pitch: float, decay: float, strength: float) -> Texture:
        turns = strength * torch.cos(2 * math.pi * lags / pitch)
        return Texture(torch.zeros(BINS), (1 - strength) * torch.exp(-lags / decay) + turns)

    regular = repeating(0.03, 0.05, 0.2)
    assert regular.repetition_difference(repeating(0.03, 0.1, 0.1)) < 0.1
    assert regular.repetition_difference(repeating(0.064, 0.05, 0.2)) > 0.5
    assert regular.repetition_difference(repeating(0.02, 0.05, 0.2)) > 0.8


def test_only_pixels_of_hair_count(course):
    picture = drawn_hair(curtain(0.1), CAMERA, torch.Generator().manual_seed(1))
    half = torch.ones(SIDE, SIDE)
    half[:, 128:] = 0
    spoilt = picture.clone()
    spoilt[:, 160:] = torch.rand(SIDE, SIDE - 160, generator=torch.Generator().manual_seed(2))
    kept = replace(course, known=course.known & (torch.arange(SIDE) < 90))
    both = [texture_of([some], [half], [kept], [CAMERA], FILTERS) for some in (picture, spoilt)]
    assert torch.allclose(both[0].lean, both[1].lean, atol=1e-4)


def test_hair_behind_the_foremost_is_darker():
    front = torch.tensor([[[-0.05, 0.0, 0.02], [0.05, 0.0, 0.02]]])
    behind = torch.tensor([[[-0.05, 0.003, -0.02], [0.05, 0.003, -0.02]]])
    alone = drawn_hair(behind, CAMERA, torch.Generator().manual_seed(1))
    # Two strands: the brightness of the one behind is the second that is drawn.
    both = drawn_hair(torch.cat([behind, front]), CAMERA, torch.Generator().manual_seed(1))
    row = int(alone.sum(dim=1).argmax())
    assert both[row].max() == pytest.approx(float(alone[row].max()) * math.exp(-0.04 / 0.02), rel=0.05)
