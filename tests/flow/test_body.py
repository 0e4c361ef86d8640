"""Hair beside the skin, on a ball whose top is scalp and whose rest is body."""

from dataclasses import replace

import pytest
import torch

from neural_strands.flow.body import SKIN, along_skin, body_voxels, lies_on_body, near_scalp
from neural_strands.flow.field import FlowField
from neural_strands.flow.unseen import HeadLayer
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.voxel_grid import VoxelGrid

RADIUS = 0.09
GRID = VoxelGrid.filling((-0.13, -0.13, -0.13), (0.13, 0.13, 0.13), 0.003)
HEIGHT = GRID.nodes().norm(dim=-1) - RADIUS
OUTWARD = torch.nn.functional.normalize(GRID.nodes(), dim=-1)
DOMAIN = (HEIGHT > -0.002) & (HEIGHT < 0.03)


@pytest.fixture
def layer() -> HeadLayer:
    coarse = VoxelGrid.filling((-0.13, -0.13, -0.13), (0.13, 0.13, 0.13), 0.008)
    nodes = coarse.nodes()
    outward = torch.nn.functional.normalize(nodes, dim=-1)
    return HeadLayer(coarse, nodes.norm(dim=-1) - RADIUS, outward, torch.zeros(coarse.shape))


@pytest.fixture
def roots(generator) -> torch.Tensor:
    away = torch.nn.functional.normalize(torch.randn(4000, 3, generator=generator), dim=-1)
    return RADIUS * away[away[:, 1] > 0.7]


def on_body(height: float, slope: float, generator: torch.Generator) -> LineSegments:
    """Segments at this height above the lower half of the ball that rise at this sine, or fall where it is negative."""
    away = torch.nn.functional.normalize(torch.randn(2000, 3, generator=generator), dim=-1)
    away = away[away[:, 1] < 0]
    side = torch.nn.functional.normalize(torch.linalg.cross(away, torch.randn(away.shape, generator=generator)), dim=-1)
    directions = slope * away + (1 - slope * slope) ** 0.5 * side
    return LineSegments(
        (RADIUS + height) * away, directions, torch.ones(len(away)), torch.zeros(len(away), dtype=torch.long)
    )


@pytest.mark.parametrize(
    ("height", "slope", "lies"),
    [(0.005, 0.0, True), (0.005, -0.3, True), (0.005, 0.7, True), (0.005, -0.7, False), (0.03, 0.0, False)],
)
def test_hair_lies_on_the_body_if_its_segments_run_along_it(
    height: float, slope: float, lies: bool, roots, layer, generator
):
    assert lies_on_body(on_body(height, slope, generator), roots, layer) == lies


def test_hair_of_the_scalp_does_not_lie_on_the_body(roots, layer):
    outward = torch.nn.functional.normalize(roots, dim=-1)
    directions = torch.nn.functional.normalize(
        torch.linalg.cross(outward, torch.tensor([[1.0, 0.0, 0.0]]).expand_as(outward)), dim=-1
    )
    number = torch.zeros(len(roots), dtype=torch.long)
    segments = LineSegments(roots + 0.005 * outward, directions, torch.ones(len(roots)), number)
    assert not lies_on_body(segments, roots, layer)
    assert not lies_on_body(segments.select(torch.arange(0)), roots, layer)


def test_a_few_segments_on_the_body_do_not_count(roots, layer, generator):
    near = on_body(0.005, 0.0, generator)
    away = on_body(0.03, 0.0, generator)
    assert lies_on_body(near, roots, layer)
    lowered = torch.arange(len(away)) < len(away) // 100
    points = torch.where(lowered[:, None], (RADIUS + 0.005) / (RADIUS + 0.03) * away.points, away.points)
    assert not lies_on_body(replace(away, points=points), roots, layer)


def test_the_body_is_inside_the_skin_and_holds_no_hair(layer):
    found = body_voxels(GRID, DOMAIN, layer)
    assert found[HEIGHT < -0.004].all()
    assert not found[HEIGHT > 0.004].any()
    assert not (found & DOMAIN).any()


@pytest.mark.parametrize("everywhere", [False, True])
def test_directions_beside_the_skin_do_not_lead_into_it(everywhere: bool, roots, layer, generator):
    given = torch.nn.functional.normalize(torch.randn(*GRID.shape, 3, generator=generator), dim=-1)
    field = FlowField(GRID, given, DOMAIN)
    found = along_skin(field, DOMAIN if everywhere else near_scalp(field, roots), layer).directions
    into, rise = (given * OUTWARD).sum(dim=-1), (found * OUTWARD).sum(dim=-1)
    from_roots = torch.cdist(GRID.nodes().reshape(-1, 3), roots).amin(dim=1).view(GRID.shape)
    # Distances are interpolated on a coarse grid, and directions straight into the skin leave next to nothing that
    # lies along it.
    skin = DOMAIN & (HEIGHT < 0) & (into > -0.8)
    reached = skin if everywhere else skin & (from_roots < SKIN - 0.003)
    assert reached.any()
    assert float(rise[reached].min()) > -0.1
    same = [HEIGHT > SKIN + 0.001, ~DOMAIN, into > 0.1]
    for kept in same if everywhere else [*same, from_roots > 2.5 * SKIN]:
        torch.testing.assert_close(found[kept], given[kept])
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(GRID.shape))
