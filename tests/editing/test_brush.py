"""A brush over a scalp whose chart is known: a half-sphere of 9 cm, seen from above as a disc of radius 0.45."""

import math

import pytest
import torch

from neural_strands.editing.brush import chart_scale, dab_under
from neural_strands.editing.region import region_weight
from neural_strands.foundation.errors import InputError

RADIUS, DISC = 0.09, 0.45
UP = torch.tensor([0.0, 1.0, 0.0])


@pytest.fixture
def scalp():
    """Roots on the upper half, and their chart: equal distances from the crown along the surface."""
    random = torch.Generator().manual_seed(0)
    turn, height = 2 * math.pi * torch.rand(4000, generator=random), torch.rand(4000, generator=random)
    flat = (1 - height**2).sqrt()
    roots = RADIUS * torch.stack([flat * turn.sin(), height, flat * turn.cos()], dim=1)
    away = DISC * height.acos() / (0.5 * math.pi)
    return roots, 0.5 + away[:, None] * torch.stack([turn.sin(), turn.cos()], dim=1)


def test_a_dab_lies_where_the_ray_meets_the_scalp(scalp):
    u, v, radius = dab_under(torch.tensor([0.0, 0.5, 0.0]), -2 * UP, *scalp, radius=0.02)
    assert math.dist((u, v), (0.5, 0.5)) < 0.02
    # Half a great circle's quarter, 0.5 pi 9 cm, is 0.45 of the chart.
    assert radius == pytest.approx(0.02 * DISC / (0.5 * math.pi * RADIUS), rel=0.3)


def test_the_near_side_is_painted_not_the_far_one(scalp):
    roots, uv = scalp
    front = dab_under(torch.tensor([0.0, 0.03, 0.6]), torch.tensor([0.0, 0.0, -1.0]), roots, uv, radius=0.02)
    painted = region_weight(uv, (front,)) > 0
    assert painted.any()
    assert float(roots[painted, 2].min()) > 0.03


def test_a_ray_beside_the_head_paints_nothing(scalp):
    with pytest.raises(InputError, match="expected a click on the scalp"):
        dab_under(torch.tensor([0.3, 0.5, 0.0]), -UP, *scalp, radius=0.02)
    with pytest.raises(InputError, match="expected a click on the scalp"):
        dab_under(torch.tensor([0.0, 0.5, 0.0]), UP, *scalp, radius=0.02)


def test_one_root_alone_has_a_dab():
    assert chart_scale(torch.zeros(1, 3), torch.full((1, 2), 0.5), 0) == 1.0
