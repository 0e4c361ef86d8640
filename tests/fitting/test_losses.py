"""Losses against naive twins and closed forms."""

import math

import pytest
import torch
from tiny_capture import ball

from neural_strands.fitting.losses import (
    ChamferConfig,
    OrientedTargets,
    alpha_loss,
    coverage_loss,
    head_penalty,
    holding_loss,
    rendering_loss,
    surface_loss,
)
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.point_grid import PointGrid


def oriented(count, generator):
    points = 0.05 * torch.rand(count, 3, generator=generator)
    return points, torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)


def targets_of(points, directions):
    return OrientedTargets(points, directions, PointGrid.build(points, 0.005))


def indexed(points):
    return PointGrid.build(points.detach(), 0.02)


def naive(x, dx, y, dy, radius, unit, signed, alike):
    total, pairs, across = 0.0, 0, 0
    for point, direction in zip(x, dx, strict=True):
        distance = (y - point).norm(dim=-1)
        best = int(distance.argmin())
        if distance[best] <= radius:
            cosine = float(direction @ dy[best])
            cosine = cosine if signed else abs(cosine)
            pairs += 1
            if math.degrees(math.acos(max(-1.0, min(1.0, cosine)))) <= alike:
                total += float(distance[best]) / unit + 1 - cosine
            else:
                across += 1
    assert alike == 180 or across > 5
    return total / pairs


@pytest.mark.parametrize("alike", [40.0, 180.0])
def test_surface_loss_is_the_naive_loop(alike, generator, device):
    x, dx = oriented(60, generator)
    y, dy = oriented(80, generator)
    points, along = x.to(device), dx.to(device)
    targets = targets_of(y.to(device), dy.to(device))
    for signed in (False, True):
        config = ChamferConfig(surface_radius=0.008, unit=0.003, signed=signed, alike=alike)
        for seen in (torch.ones(60, dtype=torch.bool), torch.arange(60) % 3 == 0):
            ours = surface_loss(points, along, seen.to(device), indexed(points), len(x), targets, config)
            expected = naive(x[seen], dx[seen], y, dy, 0.008, 0.003, signed, alike)
            torch.testing.assert_close(float(ours), expected, atol=1e-4, rtol=1e-4)


def test_a_segment_that_a_strand_follows_pulls_no_other(generator, device):
    everything, along = oriented(90, generator)
    x, dx, per_strand = everything[:60], along[:60], 5
    y, dy = oriented(80, generator)
    config = ChamferConfig(surface_radius=0.02, unit=0.003, occupied=0.006, alike=180.0)
    total, pairs, dropped = 0.0, 0, 0
    for k, (point, direction) in enumerate(zip(x, dx, strict=True)):
        distance = (y - point).norm(dim=-1)
        best = int(distance.argmin())
        follower = (everything - y[best]).norm(dim=-1)
        taken = float(follower.min()) <= 0.006 and int(follower.argmin()) // per_strand != k // per_strand
        dropped += taken
        if distance[best] <= 0.02 and not taken:
            total += float(distance[best]) / 0.003 + 1 - abs(float(direction @ dy[best]))
            pairs += 1
    everywhere, targets = indexed(everything.to(device)), targets_of(y.to(device), dy.to(device))
    seen = torch.ones(60, dtype=torch.bool, device=device)
    ours = surface_loss(x.to(device), dx.to(device), seen, everywhere, per_strand, targets, config)
    assert dropped > 5
    assert pairs > 5
    torch.testing.assert_close(float(ours), total / pairs, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("alike", [40.0, 180.0])
def test_coverage_loss_is_the_naive_loop_the_other_way(alike, generator, device):
    x, dx = oriented(60, generator)
    y, dy = oriented(80, generator)
    config = ChamferConfig(radius=0.02, unit=0.003, alike=alike)
    chosen = torch.arange(0, 80, 2)
    points, targets = x.to(device), targets_of(y.to(device), dy.to(device))
    ours = coverage_loss(points, dx.to(device), indexed(points), targets, chosen.to(device), config)
    expected = naive(y[chosen], dy[chosen], x, dx, 0.02, 0.003, False, alike)
    torch.testing.assert_close(float(ours), expected, atol=1e-4, rtol=1e-4)


def test_a_target_that_another_strand_covers_better_asks_nothing(device):
    x = torch.tensor([[0.0, 0.0, 0.0]]).to(device).requires_grad_()
    along = torch.tensor([[0.0, 1.0, 0.0]]).to(device)
    target = targets_of(torch.tensor([[0.003, 0.0, 0.0]]).to(device), along)
    chosen = torch.tensor([0]).to(device)
    other = torch.tensor([[0.002, 0.0, 0.0]]).to(device)
    alone = coverage_loss(x, along, indexed(x), target, chosen, ChamferConfig())
    with_other = coverage_loss(x, along, indexed(torch.cat([x, other])), target, chosen, ChamferConfig())
    assert float(alone.detach()) > 1.0
    assert float(with_other.detach()) == 0.0
    with_other.backward()
    assert x.grad is not None
    assert float(x.grad.abs().sum()) == 0.0


def test_gradients_pull_points_together_and_turn_directions(device):
    # Besides one point near a segment, there are one that no view sees and one that is far from all segments.
    x = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]).to(device).requires_grad_()
    dx = torch.tensor([[0.6, 0.8, 0.0]]).expand(3, 3).clone().to(device).requires_grad_()
    target = targets_of(torch.tensor([[0.001, 0.0, 0.0]]).to(device), torch.tensor([[0.0, 1.0, 0.0]]).to(device))
    seen = torch.tensor([True, False, True]).to(device)
    surface_loss(x, dx, seen, indexed(x), 1, target, ChamferConfig(alike=40.0)).backward()
    assert float(x.grad[0, 0]) < 0  # descending moves the point towards +x
    torch.testing.assert_close(dx.grad[0].cpu(), torch.tensor([0.0, -1.0, 0.0]))
    assert not x.grad[1:].cpu().any()
    assert not dx.grad[1:].cpu().any()


def test_a_segment_across_a_strand_pulls_nothing(device):
    x = torch.tensor([[0.0, 0.0, 0.0]]).to(device).requires_grad_()
    dx = torch.tensor([[0.6, 0.8, 0.0]]).to(device).requires_grad_()
    target = targets_of(torch.tensor([[0.001, 0.0, 0.0]]).to(device), torch.tensor([[0.0, 1.0, 0.0]]).to(device))
    chosen, seen = torch.tensor([0]).to(device), torch.tensor([True]).to(device)
    config = ChamferConfig(alike=36.0)  # they differ by 36.9 degrees
    surface = surface_loss(x, dx, seen, indexed(x), 1, target, config)
    coverage = coverage_loss(x, dx, indexed(x), target, chosen, config)
    (surface + coverage).backward()
    assert float(surface.detach()) == float(coverage.detach()) == 0.0
    assert x.grad is not None
    assert dx.grad is not None
    assert not x.grad.cpu().any()
    assert not dx.grad.cpu().any()


def test_rendering_and_alpha_losses_in_closed_form():
    image, target = torch.full((4, 5, 3), 0.5), torch.full((4, 5, 3), 0.3)
    torch.testing.assert_close(rendering_loss(image, target), torch.tensor(0.04))
    alpha, reference = torch.full((4, 5), 0.25), torch.ones(4, 5)
    supervised = torch.zeros(4, 5, dtype=torch.bool)
    supervised[0] = True
    torch.testing.assert_close(alpha_loss(alpha, reference, supervised), torch.tensor(0.5625))
    assert float(alpha_loss(alpha, reference, torch.zeros(4, 5, dtype=torch.bool))) == 0.0


def test_head_penalty_of_a_ball():
    mesh = ball()
    grid = SignedDistanceGrid.build(
        Mesh(torch.from_numpy(mesh.vertices).float(), torch.from_numpy(mesh.faces).long()), spacing=0.003
    )
    depth = 0.004
    along = torch.linspace(0.0, 2 * math.pi, 40)[None, :, None]
    circle = torch.cat([along.cos(), along.sin(), torch.zeros_like(along)], dim=-1)
    inside = head_penalty((0.09 - depth) * circle, grid, clearance=0.002)
    expected = ((depth + 0.002) / 0.002) ** 2
    assert abs(float(inside) / expected - 1) < 0.12
    assert float(head_penalty(0.1 * circle, grid, clearance=0.002)) == 0.0


def test_holding_is_the_mean_squared_distance_in_units():
    first = torch.zeros(2, 3, 3)
    moved = first.clone()
    moved[0, 1] = torch.tensor([0.003, 0.0, -0.004])
    # 5 mm in units of 2 mm, squared, at one of six points.
    held = torch.ones(2, 3, dtype=torch.bool)
    assert float(holding_loss(moved, first, held, 0.002)) == pytest.approx(2.5**2 / 6, rel=1e-5)
    assert float(holding_loss(first, first, held, 0.002)) == 0.0
    held[0, 1] = False
    assert float(holding_loss(moved, first, held, 0.002)) == 0.0
