"""The point nearest to several rays, against a stacked least-squares solution, and evenly spread directions."""

import math

import numpy as np
import pytest
import torch
from scipy.linalg import null_space
from torch.nn.functional import normalize

from neural_strands.geometry.rays import nearest_to_rays, spread_directions


def nearest_by_equations(origins: torch.Tensor, directions: torch.Tensor) -> np.ndarray:
    """Two equations per ray, one for each axis across it."""
    rows, right = [], []
    for origin, direction in zip(origins.double().numpy(), directions.double().numpy(), strict=True):
        for across in null_space(direction[None]).T:
            rows.append(across)
            right.append(across @ origin)
    return np.linalg.lstsq(np.stack(rows), np.array(right))[0]


@pytest.mark.parametrize("count", [2, 3, 30])
def test_rays_of_any_kind(generator, count):
    for _ in range(20):
        origins, directions = 3 * torch.randn(2, count, 3, generator=generator)
        directions = normalize(directions, dim=1)
        found = nearest_to_rays(origins, directions)
        np.testing.assert_allclose(found, nearest_by_equations(origins, directions), atol=1e-4)


def test_rays_through_one_point_meet_there(generator):
    point = torch.tensor([0.1, 1.6, -0.2])
    origins = point + torch.randn(12, 3, generator=generator)
    # A ray may also point away from where the lines meet.
    directions = normalize(point - origins, dim=1) * torch.tensor([1.0, -1.0]).repeat(6)[:, None]
    torch.testing.assert_close(nearest_to_rays(origins, directions), point, atol=1e-5, rtol=0)


def test_a_narrow_angle_is_enough():
    """Rays a tenth of a degree apart still meet where they do, 10 metres ahead."""
    point = torch.tensor([0.0, 0.0, 10.0], dtype=torch.float64)
    origins = torch.zeros(2, 3, dtype=torch.float64)
    origins[1, 0] = 10 * math.tan(math.radians(0.1))
    found = nearest_to_rays(origins, normalize(point - origins, dim=1))
    torch.testing.assert_close(found, point, atol=0.05, rtol=0)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 1.0], [0.48, -0.6, 0.64], [1.0, 2.0, -3.0]])
@pytest.mark.parametrize("count", [1, 2, 7])
def test_parallel_rays_are_answered_one_unit_ahead_of_the_mean_origin(generator, direction, count):
    origins = torch.randn(count, 3, generator=generator)
    along = normalize(torch.tensor(direction), dim=0)
    found = nearest_to_rays(origins, along.expand(count, 3))
    torch.testing.assert_close(found, origins.mean(dim=0) + along, atol=1e-5, rtol=0)


@pytest.mark.parametrize("count", [0, 1, 6, 40, 1000])
def test_spread_directions_are_units_that_balance(count):
    directions = spread_directions(count)
    torch.testing.assert_close(directions.norm(dim=1), torch.ones(count))
    if count >= 6:
        assert directions.mean(dim=0).norm() < 0.1


def test_spread_directions_leave_no_gap_and_keep_apart(generator):
    """The largest gap and the smallest distance are near those of a hexagonal packing of the same density."""
    count = 1000
    directions = spread_directions(count)
    spacing = (8 * math.pi / (count * 3**0.5)) ** 0.5
    apart = torch.cdist(directions, directions).fill_diagonal_(2.0).amin(dim=1)
    assert apart.min() > 0.7 * spacing
    anywhere = normalize(torch.randn(5000, 3, generator=generator), dim=1)
    assert torch.cdist(anywhere, directions).amin(dim=1).max() < 0.9 * spacing
