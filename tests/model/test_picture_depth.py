"""Depth of a rendered picture, compared with rays to a ball and with strands whose depth has a closed form."""

from dataclasses import replace

import pytest
import torch
from tiny_hair import RADIUS, tiny_hair_model

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.model.compositing import REACH
from neural_strands.model.picture_depth import ALLOWANCE, ON_SKIN, picture_depth
from neural_strands.model.renderer import HairRenderer

SIDE, FOCAL, AWAY = 96, 300.0, 1.0
"""Size of the picture and focal length, pixels; distance of the camera from the middle of the ball, metres."""
CAMERA = Camera.look_at(torch.tensor([0.0, 0.0, AWAY]), torch.zeros(3), FOCAL, (SIDE, SIDE), "front")


def rendered(points, opacity=1.0):
    """A ball with the given strands, 6 mm thick, and one opacity everywhere."""
    model = tiny_hair_model()
    model.strand_width = 0.006
    points = torch.tensor(points)
    strands = Strands(points, root_uv=torch.full((len(points), 2), 0.5))
    output = HairRenderer.of(model, strands).render(CAMERA)
    return replace(output, alpha=torch.full_like(output.alpha, opacity))


def straight(start, end, count=20):
    """A strand as a list of points."""
    shares = [k / (count - 1) for k in range(count)]
    return [[a + share * (b - a) for a, b in zip(start, end, strict=True)] for share in shares]


def slopes(shift=0.0):
    """Right and up over forward, of the ray of every pixel; shifted from the centre by pixels to the right and down."""
    place = (torch.arange(SIDE) + 0.5 + shift - SIDE / 2) / FOCAL
    return place.expand(SIDE, SIDE), -place[:, None].expand(SIDE, SIDE)


def to_ball(right, up):
    """Depth at which rays from the camera meet the ball; NaN where they pass it."""
    size = 1 + right**2 + up**2
    return (AWAY - (AWAY**2 - size * (AWAY**2 - RADIUS**2)).sqrt()) / size


BEHIND = [straight((-0.01, 0.0, -0.3), (0.01, 0.0, -0.3))]
"""A strand that the ball hides."""


def test_without_hair_it_is_the_depth_of_the_body():
    depth = picture_depth(rendered(BEHIND, 0.0))
    right, up = slopes()
    across = (right**2 + up**2).sqrt()
    facing = across < 0.8 * RADIUS
    # The farthest of nine rays in each pixel, which is the outermost.
    corners = [to_ball(right + x / (3 * FOCAL), up + y / (3 * FOCAL)) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    expected = torch.stack(corners).amax(dim=0) + ALLOWANCE
    assert torch.allclose(depth[facing], expected[facing], atol=5e-4)
    assert depth[across > 1.1 * RADIUS].isinf().all()


def test_hair_has_the_depth_of_the_nearest_strand():
    front = straight((-0.1, 0.02, 0.2), (0.1, 0.02, 0.2))
    back = straight((0.0, -0.1, 0.15), (0.0, 0.1, 0.15))
    slanting = straight((-0.1, -0.06, 0.1), (0.1, -0.06, 0.2))
    depth = picture_depth(rendered([front, back, slanting]))
    right, up = slopes()
    on_front = ((up * 0.8 - 0.02).abs() < 0.002) & ((right * 0.8).abs() < 0.08)
    assert torch.allclose(depth[on_front], torch.tensor(0.8 + ALLOWANCE), atol=1e-5)
    on_back = ((right * 0.85).abs() < 0.002) & ((up * 0.85 - 0.02).abs() > 0.03) & ((up * 0.85).abs() < 0.05)
    assert torch.allclose(depth[on_back], torch.tensor(0.85 + ALLOWANCE), atol=1e-5)
    # A point (x, z) of the slanting strand has z = 0.15 + x / 2, and x = right * (1 - z) on the ray of a pixel.
    ahead = 0.85 / (1 + 0.5 * right)
    on_slanting = ((up * ahead + 0.06).abs() < 0.002) & ((right * ahead).abs() < 0.08) & (right.abs() > 0.02)
    assert on_slanting.sum() > 30
    assert torch.allclose(depth[on_slanting], ahead[on_slanting] + ALLOWANCE, atol=1e-3)


def test_gaps_between_strands_have_the_depth_of_those_around_them():
    # Above the ball, so that nothing else is near.
    depth = picture_depth(rendered([straight((-0.05, 0.12, 0.0), (0.05, 0.12, 0.0))]))[:, SIDE // 2]
    row = round(SIDE / 2 - 0.12 * FOCAL)
    assert torch.allclose(depth[row - REACH : row + 1], torch.tensor(AWAY + ALLOWANCE), atol=1e-4)
    assert depth[: row - REACH - 1].isinf().all()


@pytest.mark.parametrize("height", [-0.001, 0.0005])
def test_hair_on_the_skin_is_in_front_of_it(height):
    depth = picture_depth(rendered([straight((-0.01, 0.0, RADIUS + height), (0.01, 0.0, RADIUS + height))]))
    middle = depth[SIDE // 2 - 1 : SIDE // 2 + 1, SIDE // 2 - 1 : SIDE // 2 + 1]
    assert torch.allclose(middle, torch.tensor(AWAY - RADIUS - ON_SKIN), atol=5e-4)
    assert (middle < AWAY - RADIUS).all()


def test_thin_hair_has_the_depth_of_what_lies_behind():
    strands = [straight((-0.05, 0.12, 0.0), (0.05, 0.12, 0.0))]
    assert torch.equal(picture_depth(rendered(strands, 0.4)), picture_depth(rendered(BEHIND, 0.0)))
