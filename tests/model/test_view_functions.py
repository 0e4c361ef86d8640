"""The functions of a camera's direction, against their definition: uncorrelated over the photographs."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from neural_strands.model.view_functions import COUNT, LIMIT, view_functions


def directions(count, generator, spread=math.inf):
    """Random unit directions, within about `spread` of the z axis."""
    offset = torch.randn(count, 3, generator=generator)
    return normalize(offset if math.isinf(spread) else torch.tensor([0.0, 0.0, 1.0]) + spread * offset, dim=1)


def test_they_are_uncorrelated_over_photographs_all_around(generator):
    seen = directions(200, generator)
    values = view_functions(seen, seen).double()
    torch.testing.assert_close(values.mean(dim=0), torch.zeros(COUNT).double(), atol=1e-4, rtol=0)
    torch.testing.assert_close(values.T @ values / len(seen), torch.eye(COUNT).double(), atol=1e-3, rtol=0)


def test_they_span_all_quadratic_functions(generator):
    """Any polynomial of degree 2 on the sphere is a constant and a combination of them."""
    seen = directions(300, generator)
    values = torch.cat([torch.ones(300, 1), view_functions(seen, seen)], dim=1).double()
    x, y, z = seen.double().unbind(dim=1)
    wanted = torch.stack([x, y * z, (x + 2 * y - z).square(), z * z], dim=1)
    found = values @ torch.linalg.lstsq(values, wanted).solution
    torch.testing.assert_close(found, wanted, atol=1e-5, rtol=0)


def test_photographs_of_the_face_alone_do_not_blow_up_what_hardly_differs(generator):
    seen = directions(40, generator, spread=0.01)
    values = view_functions(seen, seen).double()
    deviations = torch.linalg.eigvalsh(values.T @ values / len(seen)).clamp(min=0).sqrt()
    # Two directions across; their squares, with deviations below 0.001, stay small.
    assert ((deviations[-2:] > 0.8) & (deviations[-2:] < 1.01)).all()
    assert deviations[-3] < 0.1


def test_they_do_not_depend_on_the_order_of_the_photographs(generator):
    seen, asked = directions(20, generator), directions(5, generator)
    torch.testing.assert_close(view_functions(asked, seen), view_functions(asked, seen.flip(0)))


@pytest.mark.parametrize("count", [0, 1])
def test_without_different_photographs_nothing_changes(generator, count):
    seen = directions(count, generator)
    assert not view_functions(directions(4, generator)[:count] if count == 0 else seen, seen).any()
    assert view_functions(directions(4, generator), seen).shape == (4, COUNT)


def test_far_from_the_photographs_they_are_bounded(generator):
    seen = directions(30, generator, spread=0.1)
    values = view_functions(directions(100, generator), seen)
    assert values.abs().max() == LIMIT
    assert not view_functions(directions(100, generator), seen[:0]).any()


def test_elsewhere_they_have_the_values_of_photographs(generator):
    """Nearest photographs count most, and nothing is extrapolated."""
    seen, asked = directions(30, generator, spread=0.1), directions(100, generator)
    at_photographs = view_functions(seen, seen)
    values = view_functions(asked, seen, elsewhere=1.0)
    low, high = at_photographs.amin(dim=0), at_photographs.amax(dim=0)
    assert ((values >= low - 1e-5) & (values <= high + 1e-5)).all()
    alone = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    beside = normalize(torch.tensor([[0.05, 0.05, 1.0]]), dim=1)
    torch.testing.assert_close(view_functions(beside, alone, 1.0), view_functions(alone, alone)[:1], atol=1e-4, rtol=0)
    half = view_functions(asked, seen, elsewhere=0.5)
    torch.testing.assert_close(half, (values + view_functions(asked, seen)) / 2)
