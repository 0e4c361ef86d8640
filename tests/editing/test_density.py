"""Denser and sparser hair from the scalp textures."""

import pytest
import torch
from scipy.spatial import KDTree
from tiny_hair import RADIUS, tiny_hair_model

from neural_strands.editing.density import change_density
from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.settings import Density


@pytest.fixture(scope="module")
def model():
    return tiny_hair_model()


@pytest.mark.parametrize("count", [60, 200, 1500])
def test_so_many_strands_spread_evenly_on_the_head(model, count):
    shape = change_density(Density(count), ScalpShape.of(model), model)
    strands = shape.decode(model)
    assert len(strands) == count
    assert strands.points.isfinite().all()
    radius = shape.position.norm(dim=1)
    # On the faces of the ball, not on chords between roots far apart.
    assert (radius > RADIUS - 5e-4).all()
    assert (radius < RADIUS + 1e-6).all()
    away = KDTree(shape.position.numpy()).query(shape.position.numpy(), k=2)[0][:, 1]
    assert away.min() > 0.2 * away.mean()
    # The chart is seen from above, so uv and position must agree.
    assert torch.allclose(shape.uv[:, 0], 0.5 + 0.5 * shape.position[:, 0] / radius, atol=0.03)
    upright = torch.nn.functional.normalize(shape.position, dim=1)
    assert ((shape.frame[:, :, 2] * upright).sum(dim=1) > 0.99).all()


def test_fewer_strands_are_mostly_those_that_were_fitted(model):
    shape = ScalpShape.of(model)
    sparse = change_density(Density(60), shape, model)
    known = (torch.cdist(sparse.position, shape.position).amin(dim=1) < 1e-6).float().mean()
    assert known > 0.5


def test_same_seed_same_strands(model):
    first, second, other = (change_density(Density(100, seed), ScalpShape.of(model), model) for seed in (0, 0, 1))
    assert torch.equal(first.uv, second.uv)
    assert not torch.equal(first.uv, other.uv)
