"""Resampling: scipy's splines and closed-form curves are the oracles."""

import math
import time
from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from neural_strands.geometry.resample import (
    interpolate_evenly,
    resample,
    resample_polyline_lengths,
    resample_ragged,
    resample_strands,
)
from neural_strands.geometry.spline import fit_splines
from neural_strands.geometry.strands import Strands


def helix(angle: Tensor, radius: float = 0.01, rise: float = 0.002) -> Tensor:
    return torch.stack([radius * angle.cos(), rise * angle, radius * angle.sin()], dim=-1)


@pytest.mark.parametrize("count", [3, 4, 5, 16])
def test_spline_agrees_with_scipy(count: int, generator: torch.Generator):
    """scipy is given our end conditions M_0 = M_1, M_{n-1} = M_{n-2}; everything between is its own solve."""
    points = torch.randn(4, count, 3, generator=generator, dtype=torch.float64)
    splines = fit_splines(points, torch.full((4,), count))
    fraction = torch.linspace(0, 1, 7, dtype=torch.float64).expand(4, 7)
    for k in range(4):
        bend, knots = splines.curvature[k].numpy(), splines.knots[k].numpy()
        chords = np.linalg.norm(np.diff(points[k].numpy(), axis=0), axis=1)
        np.testing.assert_allclose(np.diff(knots), chords, rtol=1e-12)
        np.testing.assert_allclose(bend[[0, -1]], bend[[1, -2]])
        scipy_spline = CubicSpline(knots, points[k].numpy(), bc_type=((2, bend[0]), (2, bend[-1])))  # pyright: ignore[reportArgumentType]
        np.testing.assert_allclose(scipy_spline(knots, 2), bend, atol=1e-9)
        for segment in range(count - 1):
            index = torch.full((4, 7), segment)
            at = knots[segment] + fraction[k].numpy() * (knots[segment + 1] - knots[segment])
            np.testing.assert_allclose(splines.evaluate(index, fraction)[k].numpy(), scipy_spline(at), atol=1e-10)


def test_straight_line_is_exact():
    along = torch.tensor([0.0, 0.1, 0.15, 0.9, 1.0], dtype=torch.float64)
    direction = torch.tensor([1.0, 2.0, -2.0], dtype=torch.float64) / 3
    found = resample_strands((along[:, None] * direction)[None], 11)[0]
    expected = torch.linspace(0, 1, 11, dtype=torch.float64)[:, None] * direction
    torch.testing.assert_close(found, expected, atol=1e-12, rtol=0)


def test_helix_is_followed_at_equal_arc_length():
    """A helix has constant speed, so equal arc length is equal angle."""
    turns = 4 * math.pi
    coarse = helix(torch.linspace(0, turns, 33, dtype=torch.float64))
    exact = helix(torch.linspace(0, turns, 100, dtype=torch.float64))
    error = (resample_strands(coarse[None], 100)[0] - exact).norm(dim=-1)
    assert error.max() < 1e-4  # a hundredth of the radius
    linear_error = (resample_polyline_lengths(coarse[None], 100)[0] - exact).norm(dim=-1)
    assert linear_error.max() > 4 * error.max()


def test_ends_are_kept_and_steps_are_equal(generator: torch.Generator):
    points = (torch.randn(20, 12, 3, generator=generator) + torch.tensor([0.0, 4.0, 0.0])).cumsum(dim=1)
    found = resample_strands(points, 200)
    torch.testing.assert_close(found[:, 0], points[:, 0])
    torch.testing.assert_close(found[:, -1], points[:, -1])
    step = (found[:, 1:] - found[:, :-1]).norm(dim=-1)
    assert ((step / step.mean(dim=1, keepdim=True) - 1).abs() < 0.15).all()


def test_uneven_points_do_not_overshoot(generator: torch.Generator):
    """Edges of 1 and 0.05 mixed: the curve stays within half of each edge's length of the polygon."""
    step = torch.randn(100, 12, 3, generator=generator, dtype=torch.float64) + torch.tensor([0, 1.5, 0])
    short = torch.where(torch.rand(100, 12, 1, generator=generator) < 0.5, 0.05, 1.0)
    step = torch.nn.functional.normalize(step, dim=-1) * short
    points = torch.cat([torch.zeros(100, 1, 3, dtype=torch.float64), step.cumsum(dim=1)], dim=1)
    splines = fit_splines(points, torch.full((100,), 13))
    fraction = torch.linspace(0, 1, 17, dtype=torch.float64).expand(100, 17)
    for edge in range(12):
        curve = splines.evaluate(torch.full((100, 17), edge), fraction)
        start, along = points[:, edge, None], step[:, edge, None]
        share = ((curve - start) * along).sum(-1) / along.square().sum(-1)
        nearest = start + share.clamp(0, 1)[..., None] * along
        assert ((curve - nearest).norm(dim=-1) < 0.5 * along.norm(dim=-1)).all()


def test_repeated_points_and_zero_lengths_stay_finite():
    repeated = torch.tensor([[0.0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 1, 0], [0, 2, 0]])[None]
    found = resample_strands(repeated, 50)
    assert found.isfinite().all()
    assert found[..., 1].min() >= -0.05
    assert found[..., 1].max() <= 2.05
    assert resample_strands(torch.ones(1, 5, 3), 7).isfinite().all()


def test_ragged_is_each_strand_by_itself(generator: torch.Generator):
    sizes = [2, 3, 4, 9, 30, 3, 2]
    offsets = torch.tensor([0, *sizes]).cumsum(0)
    vertices = torch.randn(sum(sizes), 3, generator=generator)
    found = resample_ragged(vertices, offsets, 25)
    for k in range(len(sizes)):
        alone = resample_strands(vertices[offsets[k] : offsets[k + 1]][None], 25)[0]
        torch.testing.assert_close(found[k], alone, atol=1e-5, rtol=1e-5)


def test_polyline_resampling_against_numpy(generator: torch.Generator):
    points = torch.randn(6, 9, 3, generator=generator, dtype=torch.float64)
    found = resample_polyline_lengths(points, 31)
    for k in range(6):
        array = points[k].numpy()
        arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(array, axis=0), axis=1))])
        target = np.linspace(0, arc[-1], 31)
        expected = np.stack([np.interp(target, arc, array[:, axis]) for axis in range(3)], axis=1)
        np.testing.assert_allclose(found[k].numpy(), expected, atol=1e-7)


@pytest.mark.parametrize("resample", [resample_polyline_lengths, resample_strands])
def test_gradients(resample, generator: torch.Generator):
    points = torch.randn(2, 5, 3, generator=generator, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda value: resample(value, 7), points)


def test_too_few_points():
    for function in (resample_polyline_lengths, resample_strands):
        with pytest.raises(ValueError, match="at least two points"):
            function(torch.zeros(3, 1, 3), 10)
        with pytest.raises(ValueError, match="at least two points"):
            function(torch.zeros(3, 5, 3), 1)
    assert resample_strands(torch.zeros(0, 5, 3), 10).shape == (0, 10, 3)
    assert resample_ragged(torch.zeros(0, 3), torch.zeros(1, dtype=torch.int64), 10).shape == (0, 10, 3)


def processor_time(work: Callable[[], object]) -> float:
    start = time.process_time()
    work()
    return time.process_time() - start


def test_ten_thousand_strands_are_quick(generator: torch.Generator):
    """The goal is 1 s on one idle core. A tenth of a loop's time is asked for, whatever the speed of the machine."""
    points = (0.003 * torch.randn(10_000, 16, 3, generator=generator)).cumsum(dim=1)
    together, loop = [], []
    # On a shared processor, one run may be slow by chance, but hardly all of them.
    for _ in range(3):
        together.append(processor_time(lambda: resample_strands(points, 100)))
        loop.append(50 * processor_time(lambda: [resample_strands(each[None], 100) for each in points[::50]]))
    assert min(together) < min(loop) / 10


@pytest.mark.parametrize("count", [2, 7, 40])
def test_what_points_carry_is_resampled_with_them(count: int):
    """On uneven straight strands the arc length is known, and numpy interpolates t and width over it."""
    along = torch.tensor([[0.0, 0.1, 0.15, 0.9, 1.0], [0.0, 0.4, 0.5, 1.4, 2.0]], dtype=torch.float64)
    points = along[..., None] * torch.tensor([2.0, -1.0, 2.0], dtype=torch.float64) / 3
    t = torch.tensor([[0.0, 0.1, 0.2, 0.3, 0.6], [0.2, 0.3, 0.5, 0.9, 1.0]], dtype=torch.float64)
    width = torch.rand(2, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    uv = torch.rand(2, 2)
    found = resample(Strands(points, root_uv=uv, width=width, t=t), count)
    assert torch.equal(found.points, resample_strands(points, count))
    assert found.root_uv is uv
    for value, at_points in ((found.t, t), (found.width, width)):
        assert value is not None
        for k in range(2):
            target = np.linspace(0, float(along[k, -1]), count)
            expected = np.interp(target, along[k].numpy(), at_points[k].numpy())
            np.testing.assert_allclose(value[k].numpy(), expected, atol=1e-6)


def test_even_parameters_are_stored_where_points_are_not_even():
    along = torch.tensor([0.0, 0.04, 0.2, 1.0])
    found = resample(Strands(along[None, :, None] * torch.ones(3)), 5)
    assert found.width is None
    assert found.t is not None
    expected = np.interp(np.linspace(0, 1, 5), along.numpy(), np.linspace(0, 1, 4))
    np.testing.assert_allclose(found.t[0].numpy(), expected, atol=1e-5)
    assert len(resample(Strands(torch.zeros(0, 4, 3)), 5)) == 0


def test_a_gradient_goes_to_the_points_but_not_through_t(generator: torch.Generator):
    points = torch.randn(3, 6, 3, generator=generator).cumsum(dim=1).requires_grad_()
    found = resample(Strands(points), 9)
    assert found.t is not None
    assert not found.t.requires_grad
    found.points.sum().backward()
    assert points.grad is not None
    assert points.grad.abs().sum() > 0


@pytest.mark.parametrize(("points", "count"), [(2, 5), (9, 9), (9, 31), (12, 4)])
def test_even_interpolation_agrees_with_numpy(points: int, count: int, generator: torch.Generator):
    values = torch.randn(6, points, 3, generator=generator)
    found = interpolate_evenly(values, count)
    places = np.linspace(0, points - 1, count)
    for strand in range(6):
        for channel in range(3):
            expected = np.interp(places, np.arange(points), values[strand, :, channel])
            np.testing.assert_allclose(found[strand, :, channel], expected, atol=1e-5)
    assert torch.equal(interpolate_evenly(values[..., 0], count), found[..., 0])
