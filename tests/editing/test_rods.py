"""Rods against mechanics: equilibrium, pendulum, cantilever, a dense minimiser of the same energy, lengths, a ball."""

import math

import pytest
import torch
from torch import Tensor

from neural_strands.editing.rods.rods import GRAVITY, RodConfig, Rods
from neural_strands.editing.rods.step import RodState, advance, segment_turns, unconstrained
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.strands import segments
from neural_strands.geometry.voxel_grid import VoxelGrid

LENGTH = 0.3


def hanging(points: int = 30) -> Tensor:
    """A straight strand that hangs, and a helix of five turns beside it."""
    share = torch.linspace(0, 1, points)
    straight = torch.stack([0 * share, -LENGTH * share, 0 * share], dim=1)
    turn = 10 * math.pi * share
    helix = straight + 0.01 * torch.stack([turn.cos() - 1, 0 * turn, turn.sin()], dim=1)
    return torch.stack([straight, helix])


def moved(rods: Rods, seconds: float, push: Tensor, state: RodState | None = None, body=None) -> RodState:
    state = RodState.at_rest(rods) if state is None else state
    clearance = torch.zeros(rods.rest.shape[:2])
    for _ in range(round(seconds / rods.seconds)):
        advance(state, rods, push, body, clearance)
    return state


def along_x(rods: Rods, acceleration: float) -> Tensor:
    return torch.tensor([acceleration, 0.0, 0.0]).expand_as(rods.rest).contiguous()


def test_without_wind_nothing_moves():
    rods = Rods.at_rest(hanging(), RodConfig(), 1 / 240)
    state = moved(rods, 1.0, torch.zeros_like(rods.rest))
    assert torch.allclose(state.points, rods.rest, atol=1e-6)


def test_a_hanging_chain_swings_with_the_period_of_its_first_mode():
    # Bernoulli: shapes J0(2 w sqrt(y / g)) over the height y above the tip, w = j / 2 sqrt(g / L), J0(j) = 0.
    first_zero = 2.404826
    frequency = first_zero / 2 * math.sqrt(GRAVITY / LENGTH)
    points = hanging(60)[:1]
    height = LENGTH + points[0, :, 1]
    shape = torch.special.bessel_j0(first_zero * (height / LENGTH).clamp(min=0).sqrt())
    rods = Rods.at_rest(points, RodConfig(bending=1e-9, drag=0.0), 1 / 480)
    state = RodState.at_rest(rods)
    state.points[0, :, 0] = 0.01 * shape
    tips = []
    for _ in range(600):
        moved(rods, rods.seconds, torch.zeros_like(points), state)
        tips.append(float(state.points[0, -1, 0]))
    tip = torch.tensor(tips)
    crossings = ((tip[1:] < 0) != (tip[:-1] < 0)).nonzero()[:, 0].float() / 480
    # From the first quarter of a period on, the tip passes the middle every half period.
    assert len(crossings) >= 2
    assert crossings[0] == pytest.approx(math.pi / 2 / frequency, rel=0.03)
    assert crossings[1] - crossings[0] == pytest.approx(math.pi / frequency, rel=0.03)


def test_a_cantilever_bends_as_far_as_beam_theory_says():
    # Uniform load q per length and stiffness B: the tip moves by q L^4 / (8 B).
    bending, load = 0.169, 1.0
    rods = Rods.at_rest(hanging(60)[:1], RodConfig(bending=bending, gravity=0.0, drag=30.0), 1 / 240)
    state = moved(rods, 1.0, along_x(rods, load))
    assert float(state.points[0, -1, 0]) == pytest.approx(load * LENGTH**4 / (8 * bending), rel=0.03)


def test_wind_as_strong_as_the_weight_lifts_a_strand_by_45_degrees():
    rods = Rods.at_rest(hanging()[:1], RodConfig(), 1 / 240)
    tip = segments(moved(rods, 2.5, along_x(rods, GRAVITY)).points)[0, -1]
    assert math.degrees(math.atan2(tip[0], -tip[1])) == pytest.approx(45.0, abs=0.5)


def test_curls_remain_in_the_wind_and_return_after_it():
    rods = Rods.at_rest(hanging(), RodConfig(), 1 / 240)
    state = moved(rods, 1.5, along_x(rods, GRAVITY))
    lifted = state.points.clone()
    # Its ends could be as far apart as it is long, 1.45 times what they are at rest.
    assert (lifted[1, -1] - lifted[1, 0]).norm() < 1.25 * LENGTH
    assert (lifted - rods.rest)[:, -1, 0].min() > 0.05
    returned = moved(rods, 2.0, torch.zeros_like(rods.rest), state)
    assert torch.allclose(returned.points, rods.rest, atol=2e-3)


def test_lengths_hold_in_a_storm():
    rods = Rods.at_rest(hanging(), RodConfig(), 1 / 240)
    state = RodState.at_rest(rods)
    random = torch.Generator().manual_seed(0)
    for _ in range(100):
        push = 20 * GRAVITY * torch.randn(rods.rest.shape, generator=random)
        moved(rods, rods.seconds, push, state)
        assert torch.allclose(segments(state.points).norm(dim=-1), rods.length, rtol=1e-3)
    assert state.points.isfinite().all()


def ball_grid(radius: float, centre: tuple[float, float, float]) -> SignedDistanceGrid:
    grid = VoxelGrid.filling([c - 2 * radius for c in centre], [c + 2 * radius for c in centre], radius / 12)
    return SignedDistanceGrid(grid, (grid.nodes() - torch.tensor(centre)).norm(dim=-1) - radius)


def test_rods_lie_on_a_ball_and_never_enter_it():
    radius, centre = 0.06, (0.1, -0.2, 0.0)
    body = ball_grid(radius, centre)
    rods = Rods.at_rest(hanging(), RodConfig(), 1 / 240)
    state = RodState.at_rest(rods)
    closest = []
    for _ in range(10):
        moved(rods, 0.1, along_x(rods, 2 * GRAVITY), state, body)
        assert torch.allclose(segments(state.points).norm(dim=-1), rods.length, rtol=1e-3)
        closest.append(float((state.points - torch.tensor(centre)).norm(dim=-1).min()))
    # The grid blends between nodes, 5 mm apart, of a ball of 60 mm: 0.2 mm at most.
    assert min(closest) > radius - 3e-4
    assert min(closest) < radius + 2e-3


def test_a_step_minimises_the_energy_of_the_rod():
    rest = hanging(12).double().float()
    config = RodConfig(bending=2e-3)
    rods = Rods.at_rest(rest, config, 1 / 120)
    random = torch.Generator().manual_seed(1)
    state = RodState.at_rest(rods)
    # Somewhere along the way, so that turns are not trivial.
    moved(rods, 0.3, along_x(rods, 15.0), state)
    points, velocity = state.points.double().clone(), state.velocity.double().clone()
    push = 5 * torch.randn(rest.shape, generator=random)
    turns = segment_turns(state, rods).double()

    def energy(unknown: Tensor) -> Tensor:
        """The energy of the implicit step, from its definition, segment by segment."""
        here = torch.cat([rest[:, :1].double(), unknown], dim=1)
        length, mass = rods.length.double(), rods.mass.double()
        rate = 1 / rods.seconds
        inertia = here - points - velocity / rate - push.double() / rate**2
        total = 0.5 * rate**2 * (mass[:, 1:, None] * inertia[:, 1:].square()).sum()
        total = total + 0.5 * rate * config.drag * (mass[:, 1:, None] * (here - points)[:, 1:].square()).sum()
        now, then = segments(here) / length[..., None], segments(rest.double()) / length[..., None]
        for k in range(length.shape[1]):
            below = mass[:, k + 1 :].sum(dim=1)
            total = total + 0.5 * config.gravity * (below * length[:, k] * (now - then)[:, k].square().sum(dim=1)).sum()
            if k:
                axis, real = turns[:, k - 1, :3], turns[:, k - 1, 3:]
                bend = then[:, k] - then[:, k - 1]
                twice = 2 * torch.linalg.cross(axis, bend)
                carried = bend + real * twice + torch.linalg.cross(axis, twice)
                differs = (now[:, k] - now[:, k - 1] - carried).square().sum(dim=1)
                total = total + 0.5 * (config.bending / (0.5 * (length[:, k] + length[:, k - 1])) * differs).sum()
        held = (now - then)[:, 0].square().sum(dim=1)
        return total + 0.5 * (config.bending / (0.5 * length[:, 0]) * held).sum()

    start = points[:, 1:].clone()
    size = start.numel()
    gradient = torch.as_tensor(torch.autograd.functional.jacobian(energy, start)).reshape(size)
    hessian = torch.as_tensor(torch.autograd.functional.hessian(energy, start)).reshape(size, size)
    expected = start - torch.linalg.solve(hessian, gradient).reshape(start.shape)

    found = rods.rest.double() + unconstrained(state, rods, push)
    assert torch.allclose(found[:, 1:], expected, atol=2e-6)


def test_rods_need_two_points():
    with pytest.raises(ValueError, match="at least two points, found 1"):
        Rods.at_rest(torch.zeros(3, 1, 3), RodConfig(), 1 / 240)
