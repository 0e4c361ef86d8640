"""Similarity fits: known transforms are recovered, and grooms without heads are placed on theirs."""

import math

import pytest
import torch

from neural_strands.scalp.fit_similarity import Similarity, fit_similarity, umeyama
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import attach_roots, sample_roots


def rotation(axis, degrees):
    """Rotation matrix about an axis (Rodrigues)."""
    x, y, z = torch.nn.functional.normalize(torch.tensor(axis, dtype=torch.float64), dim=0)
    cross = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)
    angle = math.radians(degrees)
    return torch.eye(3, dtype=torch.float64) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def roots(count=1500, seed=1):
    return sample_roots(mannequin(), count, torch.Generator().manual_seed(seed)).position


@pytest.mark.parametrize(
    ("scale", "axis", "degrees"),
    [(250.0, [1.0, 0, 0], 90.0), (0.01, [0.3, 1.0, -0.2], 12.0), (39.4, [1.0, 1, 1], 120.0)],
)
def test_known_transform_is_recovered(scale, axis, degrees):
    turn = rotation(axis, degrees)
    true = Similarity(scale, turn, scale * torch.tensor([0.3, -1.0, 0.5], dtype=torch.float64))
    found = fit_similarity(mannequin(), true.apply(roots()))
    assert found.scale == pytest.approx(scale, rel=0.015)
    cosine = 0.5 * (torch.trace(found.rotation.T @ turn) - 1)
    assert math.degrees(math.acos(min(1.0, float(cosine)))) < 3.0
    assert found.residual < 0.005 * scale
    moved = mannequin().transformed(found.scale, found.rotation, found.translation)
    assert attach_roots(moved, true.apply(roots()).float()).distance.quantile(0.95) < 0.003 * scale


def test_noise_strays_and_missing_parts_are_survived(generator):
    positions = roots(3000)
    kept = positions[positions[:, 1] > 0.02] * 100
    noisy = kept + 0.2 * torch.randn(kept.shape, generator=generator)
    noisy[:50] += 3.0
    found = fit_similarity(mannequin(), noisy, any_axes=False)
    assert found.scale == pytest.approx(100, rel=0.05)


def test_umeyama_is_exact_without_noise(generator):
    source = torch.randn(20, 3, generator=generator, dtype=torch.float64)
    true = Similarity(2.5, rotation([1.0, 2, 3], 77), torch.tensor([1.0, 2, 3], dtype=torch.float64))
    found = umeyama(source.numpy(), true.apply(source).numpy(), torch.ones(20).numpy())
    assert found.scale == pytest.approx(2.5)
    torch.testing.assert_close(found.rotation, true.rotation)
    torch.testing.assert_close(found.inverse().apply(true.apply(source)), source)


def test_too_few_roots():
    with pytest.raises(ValueError, match="ten roots"):
        fit_similarity(mannequin(), torch.zeros(5, 3))
