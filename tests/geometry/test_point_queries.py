import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import (
    match_levels,
    match_levels_reference,
    nearest,
    nearest_reference,
)

THRESHOLDS = [(1e-3, math.radians(10)), (2e-3, math.radians(20)), (3e-3, math.radians(30)), (4e-3, math.radians(40))]


def cloud(count: int, spread: float, generator: torch.Generator, device: torch.device) -> torch.Tensor:
    return (torch.rand(count, 3, generator=generator) * spread).to(device)


def units(count: int, generator: torch.Generator, device: torch.device) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1).to(device)


@pytest.mark.parametrize("radius", [2e-4, 3e-3, 0.02, 1.0])
def test_nearest_equals_its_twin(device, generator, radius):
    points, queries = cloud(3000, 0.05, generator, device), cloud(2500, 0.06, generator, device) - 0.005
    distance, index = nearest(queries, points, radius)
    expected_distance, expected_index = nearest_reference(queries, points, radius)
    torch.testing.assert_close(distance, expected_distance, rtol=1e-5, atol=1e-9)
    assert torch.equal(index, expected_index)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), spread=st.sampled_from([1e-6, 1e-2, 5.0, 300.0]), cell=st.sampled_from([0.3, 1, 7]))
def test_any_cell_size_gives_the_same_answer(seed, spread, cell):
    random = torch.Generator().manual_seed(seed)
    points, queries = torch.randn(200, 3, generator=random) * spread, torch.randn(100, 3, generator=random) * spread
    radius = 0.4 * spread
    distance, index = nearest(queries, PointGrid.build(points, radius, cell * radius), radius)
    expected_distance, expected_index = nearest_reference(queries, points, radius)
    same = (index == expected_index) | ((distance - expected_distance).abs() <= 1e-6 * distance)
    # Only a distance that equals the radius up to rounding may be judged either way.
    at_radius = (torch.minimum(distance, expected_distance) - radius).abs() < 1e-5 * radius
    assert (same | at_radius).all()


def test_ties_go_to_the_lowest_index_and_nothing_gives_infinity(device):
    points = torch.tensor([[1.0, 0, 0], [0, 0, 0], [0, 0, 0], [2.0, 0, 0]], device=device)
    queries = torch.tensor([[0.0, 0, 0], [1.5, 0, 0], [9.0, 0, 0], [math.nan, 0, 0], [math.inf, 0, 0]], device=device)
    distance, index = nearest(queries, points, 0.5)
    assert index.tolist() == [1, 0, -1, -1, -1]
    assert distance.tolist() == [0.0, 0.5, math.inf, math.inf, math.inf]
    assert nearest(queries, points[:0], 0.5)[1].tolist() == [-1] * 5
    assert len(nearest(queries[:0], points, 0.5)[0]) == 0
    with pytest.raises(ValueError, match="finite"):
        nearest(points, queries, 0.5)


def test_levels_equal_their_twin(device, generator):
    points, queries = cloud(4000, 0.03, generator, device), cloud(3000, 0.03, generator, device)
    arguments = queries, units(3000, generator, device), points, units(4000, generator, device), THRESHOLDS
    unsigned, signed = match_levels(*arguments)
    expected_unsigned, expected_signed = match_levels_reference(*arguments)
    assert torch.equal(unsigned, expected_unsigned)
    assert torch.equal(signed, expected_signed)
    assert set(unsigned.tolist()) == {0, 1, 2, 3, 4}
    assert (unsigned <= signed).all()
    for level, (radius, angle) in enumerate(THRESHOLDS):
        alone = match_levels(*arguments[:4], [(radius, angle)])
        assert torch.equal(alone[0] == 0, unsigned <= level)
        assert torch.equal(alone[1] == 0, signed <= level)


def test_thresholds_must_grow():
    point = torch.zeros(1, 3)
    with pytest.raises(ValueError, match="growing"):
        match_levels(point, point, point, point, [(2e-3, 0.1), (1e-3, 0.2)])


def test_two_clusters_a_kilometre_apart(generator):
    near = torch.rand(500, 3, generator=generator) * 0.01
    points = torch.cat([near, near.double().add(1000.0).float()])
    distance, index = nearest(points, points, 1e-3)
    # Far from the origin, float32 rounds several points to one, so only the distances must agree.
    assert (distance == 0).all()
    assert torch.equal(points[index], points)
    assert torch.equal(nearest(near, points, 1e-3)[1], torch.arange(500))
