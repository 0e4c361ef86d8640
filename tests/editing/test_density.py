"""Denser and sparser hair from the scalp textures."""

from dataclasses import replace

import pytest
import torch
from scipy.spatial import KDTree
from tiny_hair import RADIUS, tiny_hair_model

from neural_strands.editing.density import change_density
from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.settings import Density
from neural_strands.geometry.strands import lengths
from neural_strands.prior.vae import load_prior


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
    # The chart is seen from above, so uv and position agree, except where a stray takes its neighbour's place.
    off = (shape.uv[:, 0] - 0.5 - 0.5 * shape.position[:, 0] / radius).abs()
    assert off.median() < 1e-2
    assert off.max() < 0.2
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


def test_between_hair_that_differs_new_strands_follow_one_side(model):
    """Texels of short and of long strands meet at u = 0.5: interpolated strands would have neither length."""
    shape = ScalpShape.of(model)
    texture = torch.zeros_like(shape.texture)
    for columns, length in ((slice(None, 8), 0.02), (slice(8, None), 0.3)):
        wanted = torch.linspace(0, length, 100)[None, :, None] * torch.tensor([0.0, 0.0, 1.0])
        texture[:, columns] = load_prior().without_modulator().encode(wanted)[0]
    # Roots in the texels' centres, so that none of them blends.
    centred = replace(shape, texture=texture, uv=((shape.uv * 16).floor() + 0.5) / 16)
    grown = lengths(change_density(Density(1000), centred, model).decode(model).points)
    between = (grown > 0.04) & (grown < 0.2)
    assert between.float().mean() < 0.01
    blended = lengths(replace(centred, uv=shape.uv).decode(model).points)
    assert ((blended > 0.04) & (blended < 0.2)).float().mean() > 0.01
