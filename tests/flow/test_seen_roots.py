"""Segments followed back to a ball, along spirals whose course is known."""

import math

import pytest
import torch
from tiny_capture import RADIUS, ball

from neural_strands.flow.field import FlowField
from neural_strands.flow.seen_roots import ROOTED, one_in_each_cell, seen_roots, trace_back
from neural_strands.flow.tracing import TraceConfig
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.voxel_grid import VoxelGrid

CONFIG = TraceConfig(longest=0.2)
SLOPE = math.radians(50)
"""Angle between the spirals and the radius; they turn about the y axis."""


@pytest.fixture(scope="module")
def distance() -> SignedDistanceGrid:
    mesh = Mesh(torch.from_numpy(ball().vertices).float(), torch.from_numpy(ball().faces).long())
    return SignedDistanceGrid.build(mesh, 0.004, 0.02)


def spirals(slope: float) -> FlowField:
    """Near the plane y = 0: logarithmic spirals, which leave the ball at a constant angle to the radius."""
    grid = VoxelGrid((-0.15, -0.01, -0.15), 0.002, (151, 11, 151))
    x, _, z = grid.nodes().unbind(dim=-1)
    out = torch.stack([x, torch.zeros_like(x), z], dim=-1)
    out = out / out.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    around = torch.stack([-out[..., 2], torch.zeros_like(x), out[..., 0]], dim=-1)
    return FlowField(grid, math.cos(slope) * out + math.sin(slope) * around, torch.ones(grid.shape, dtype=torch.bool))


def ring(radius: float, count: int) -> torch.Tensor:
    angle = torch.linspace(0, 2 * math.pi, count + 1)[:-1]
    return radius * torch.stack([angle.cos(), torch.zeros_like(angle), angle.sin()], dim=-1)


def azimuth(points: torch.Tensor) -> torch.Tensor:
    return torch.atan2(points[:, 2], points[:, 0])


def test_spirals_lead_back_to_where_they_left_the_ball(distance):
    points = ring(0.13, 24)
    ends = trace_back(spirals(SLOPE), points, torch.ones_like(points), distance, CONFIG)
    assert len(ends) == 24
    assert (distance(ends) <= ROOTED).all()
    assert (distance(ends) > ROOTED - CONFIG.step).all()
    # Along such a spiral, the angle grows with the logarithm of the radius.
    turned = math.tan(SLOPE) * torch.log(points.norm(dim=-1) / ends.norm(dim=-1))
    off = (azimuth(points) - azimuth(ends) - turned + math.pi) % (2 * math.pi) - math.pi
    assert off.abs().max() < 0.01


def test_hair_that_circles_the_ball_has_no_root(distance):
    points = ring(0.13, 24)
    assert len(trace_back(spirals(math.pi / 2), points, torch.ones_like(points), distance, CONFIG)) == 0


def test_only_hair_of_the_scalp_counts(distance):
    points = torch.cat([ring(0.13, 240), ring(0.12, 240)])
    segments = LineSegments(points, torch.ones_like(points), torch.ones(480), torch.arange(480))
    half = ring(RADIUS, 720)
    half = half[half[:, 0] > 0]

    def found(most: int) -> torch.Tensor:
        return seen_roots(spirals(0.0), segments, half, most, distance, CONFIG, torch.Generator().manual_seed(0))

    assert 20 < len(found(60)) < 50
    every = found(1000)
    # Half of the hair grows where there is no scalp, apart from a margin of 6 mm.
    assert 200 < len(every) < 280
    assert every[:, 0].min() > -0.0065
    assert torch.equal(every, found(1000))


def test_without_segments_there_are_no_roots(distance):
    nothing = LineSegments(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0), torch.zeros(0, dtype=torch.long))
    scalp = ring(RADIUS, 720)
    assert len(seen_roots(spirals(0.0), nothing, scalp, 9, distance, CONFIG, torch.Generator().manual_seed(0))) == 0


def test_one_point_of_each_cell(generator):
    points = torch.rand(2000, 3, generator=generator)
    chosen = one_in_each_cell(points, 0.2, generator)
    cells = [tuple(cell) for cell in (points / 0.2).floor().long().tolist()]
    assert sorted(cells[k] for k in chosen.tolist()) == sorted(set(cells))
    # Neither the first of a cell nor the cells in order.
    firsts = {cell: k for k, cell in reversed(list(enumerate(cells)))}
    assert sum(firsts[cells[k]] == k for k in chosen.tolist()) < len(chosen) / 2
    assert chosen.tolist() != sorted(chosen.tolist())
