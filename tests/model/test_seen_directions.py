"""Cameras far from all photographs, compared with closed forms and with hair that is really rotated."""

import math

import pytest
import torch
from test_model_hair_model import model, stubble

from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel
from neural_strands.model.seen_directions import seen_from, share_elsewhere, turn_to_seen, usual_gap

UP = torch.tensor([0.0, 1.0, 0.0])


def direction(azimuth: float, height: float = 0.0) -> torch.Tensor:
    """Unit direction from degrees about the vertical, from the front, and above the horizon."""
    a, h = math.radians(azimuth), math.radians(height)
    return torch.tensor([math.cos(h) * math.sin(a), math.sin(h), math.cos(h) * math.cos(a)])


def arc(last: int, height: float = 0.0) -> torch.Tensor:
    """Photographs every 15 degrees up to `last` on both sides."""
    return torch.stack([direction(azimuth, height) for azimuth in range(-last, last + 1, 15)])


def test_near_photographs_nothing_turns():
    for azimuth in (0, 37, 90, 112):
        assert turn_to_seen(0.7 * direction(azimuth), arc(90)) is None
    assert turn_to_seen(direction(180), torch.zeros(0, 3)) is None
    ring = torch.stack([direction(azimuth) for azimuth in range(0, 360, 40)])
    assert turn_to_seen(direction(20), ring) is None
    close = torch.stack([direction(azimuth) for azimuth in range(0, 25, 4)])
    assert turn_to_seen(direction(-14.5), close) is None
    assert turn_to_seen(direction(-17), close) is not None


def test_no_photograph_turns(generator):
    # A fit relies on this: it renders photographs' cameras without asking.
    for count in (1, 2, 30):
        places = torch.randn(count, 3, generator=generator)
        seen = seen_from(places, torch.zeros(3))
        assert [turn_to_seen(place, seen) for place in places] == [None] * count


def test_from_behind_the_hair_is_turned_about_the_vertical():
    turn = turn_to_seen(direction(180, 10), arc(45, 10))
    assert turn is not None
    torch.testing.assert_close(turn @ turn.T, torch.eye(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(turn @ UP, UP, atol=0.05, rtol=0)
    assert torch.rad2deg(torch.acos((arc(45, 10) @ (turn @ direction(180, 10))).max())) < 15


@pytest.mark.parametrize("place", [direction(150), direction(100, 60), direction(-170, -40), direction(10, 89.99)])
def test_what_a_camera_sees_after_turning_was_photographed(place):
    seen = arc(45)
    turn = turn_to_seen(place, seen)
    assert turn is not None
    assert torch.linalg.det(turn) == pytest.approx(1, abs=1e-5)
    before, after = (torch.rad2deg(torch.acos((seen @ way).max().clamp(max=1))) for way in (place, turn @ place))
    assert after < min(float(before), 25.0)


def test_the_turn_begins_and_goes_on_gently():
    seen, before = arc(90), torch.eye(3)
    for azimuth in torch.arange(110, 250, 0.5).tolist():
        turn = turn_to_seen(direction(azimuth), seen)
        turn = torch.eye(3) if turn is None else turn
        cosine = (torch.trace(turn @ before.T) - 1) / 2
        assert torch.rad2deg(torch.acos(cosine.clamp(-1, 1))) < 8
        before = turn


def test_between_photographs_nothing_is_elsewhere():
    ring = torch.stack([direction(azimuth) for azimuth in range(0, 360, 40)])
    places = [direction(azimuth, height) for azimuth in range(0, 360, 5) for height in (-20, 0, 20)]
    assert {share_elsewhere(0.7 * place, ring) for place in places} == {0.0}
    assert share_elsewhere(direction(180), torch.zeros(0, 3)) == 0.0
    assert share_elsewhere(torch.zeros(3), ring) == 0.0
    assert share_elsewhere(direction(5), direction(5).repeat(3, 1)) == 0.0


def test_a_camera_is_gradually_elsewhere():
    # Photographs 15 degrees apart up to 90: from 11.25 degrees further on to 22.5.
    beyond = torch.arange(0, 60, 0.5)
    shares = [share_elsewhere(direction(90 + float(angle)), arc(90)) for angle in beyond]
    expected = smoothstep((beyond - 11.25) / 11.25).tolist()
    assert shares == pytest.approx(expected, abs=1e-3)
    # A single photograph: from half of the angle on from which directions turn.
    assert [share_elsewhere(direction(angle), arc(0)) for angle in (7, 15)] == pytest.approx([0.0, 1.0], abs=1e-3)
    assert 0.4 < share_elsewhere(direction(11.25), arc(0)) < 0.6


def test_appearance_changes_elsewhere_and_only_there(generator: torch.Generator):
    hair = model()
    randomise(hair, generator)
    strands, middle = stubble(hair), hair.background.centre
    front, back = (Camera.look_at(middle + 0.5 * direction(a), middle, 60.0, (32, 32)) for a in (0, 180))
    hair.seen_from = arc(60)
    before = [hair.render(strands, camera).hair_rgb for camera in (front, back)]
    with torch.no_grad():
        hair.textures.elsewhere.copy_(torch.randn(hair.textures.elsewhere.shape, generator=generator))
        changed = hair.textures.appearance + hair.textures.elsewhere
    near, far = (hair.render(strands, camera).hair_rgb for camera in (front, back))
    assert torch.equal(near, before[0])
    assert torch.equal(hair.render(strands, back, photographed=True).hair_rgb, untouched(hair, strands, back))
    with torch.no_grad():
        hair.textures.appearance.copy_(changed)
        hair.textures.elsewhere.zero_()
    torch.testing.assert_close(far, hair.render(strands, back).hair_rgb)
    assert (far - before[1]).abs().max() > 0.1


def untouched(hair: HairModel, strands: Strands, camera: Camera) -> torch.Tensor:
    """The hair of a model that knows no photographs."""
    seen, hair.seen_from = hair.seen_from, torch.zeros(0, 3)
    found = hair.render(strands, camera).hair_rgb
    hair.seen_from = seen
    return found


def test_directions_are_those_to_the_cameras():
    places = torch.tensor([[1.0, 2.0, 3.0], [1.0, 0.0, 3.0]])
    torch.testing.assert_close(seen_from(places, torch.tensor([1.0, 1.0, 3.0])), torch.stack([UP, -UP]))


def test_unseen_hair_looks_as_if_it_were_turned_to_the_photographs(generator: torch.Generator):
    hair = model()
    randomise(hair, generator)
    middle = hair.background.centre
    strands = stubble(hair)
    back = Camera.look_at(middle + 0.5 * direction(180), middle, 60.0, (32, 32))
    untouched = hair.render(strands, back).hair_rgb
    hair.seen_from = arc(60)
    found = hair.render(strands, back)
    turn = turn_to_seen(direction(180), hair.seen_from)
    assert turn is not None
    hair.seen_from = torch.zeros(0, 3)
    turned = Strands((strands.points - middle) @ turn.T + middle, root_uv=strands.root_uv)
    camera = Camera.look_at(middle + 0.5 * turn @ direction(180), middle, 60.0, (32, 32))
    # The same pixels see the same strands; only the grid around the hair is different.
    lines = hair.draw(turned, camera).lines
    drawn = hair.draw(strands, back).lines
    same = (lines.segment == drawn.segment).float().mean()
    assert same > 0.9
    expected = hair.render(turned, camera).hair_rgb
    covered = found.coverage > 0
    close = (found.hair_rgb - expected)[covered].abs().mean()
    assert close < 0.25 * (untouched - expected)[covered].abs().mean()


def randomise(hair: HairModel, generator: torch.Generator) -> None:
    """Shading that depends on every direction."""
    with torch.no_grad():
        for weight in (hair.shading.outer, hair.textures.appearance):
            weight.copy_(torch.randn(weight.shape, generator=generator))


def test_a_model_keeps_where_it_was_seen_from():
    hair, other = model(), model()
    hair.seen_from = arc(45)
    other.load_state_dict(hair.state_dict())
    torch.testing.assert_close(other.seen_from, hair.seen_from)
    older = {**hair.state_dict(), "_extra_state": torch.tensor([1e-4, 0.0], dtype=torch.float64)}
    other.load_state_dict(older)
    assert len(other.seen_from) == 0


def test_the_usual_gap_is_that_of_most_photographs():
    gap = math.radians(7)
    angles = torch.tensor([0.0, gap, 2 * gap, 3 * gap, 2.0])
    seen = torch.stack([angles.sin(), torch.zeros(5), angles.cos()], dim=1)
    assert usual_gap(seen) == pytest.approx(gap, abs=1e-3)
    assert usual_gap(seen[:1]) == math.inf
