"""Diffused directions against a dense linear solve and closed forms."""

import pytest
import torch

from neural_strands.flow.field import FlowConfig, diffuse_directions, grid_around
from neural_strands.flow.filling import pull_push
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.voxel_grid import VoxelGrid


def segments_at(points, directions):
    count = len(points)
    return LineSegments(points, directions, torch.ones(count), torch.arange(count))


def test_directions_between_two_walls_solve_laplace():
    # Directions are fixed on two walls at x = 0 and x = 6 voxels; between them, the mean of neighbours is linear in x.
    grid = VoxelGrid((0.5, 0.5, 0.5), 1.0, (7, 3, 3))
    centres = grid.nodes()
    walls = torch.cat([centres[0].reshape(-1, 3), centres[-1].reshape(-1, 3)])
    down, side = torch.tensor([0.0, -1.0, 0.0]), torch.tensor([0.0, 0.0, 1.0])
    directions = torch.cat([down.expand(9, 3), side.expand(9, 3)])
    domain = torch.ones(grid.shape, dtype=torch.bool)
    nothing = torch.zeros(0, 3)
    field = diffuse_directions(
        grid, domain, segments_at(walls, directions), nothing, nothing, FlowConfig(iterations=600)
    )
    share = torch.linspace(0, 1, 7)[:, None]
    expected = torch.nn.functional.normalize((1 - share) * down + share * side, dim=-1)
    torch.testing.assert_close(field.directions[:, 1, 1], expected, atol=2e-3, rtol=0)


def test_diffusion_agrees_with_a_dense_solve_on_a_ragged_domain(generator):
    grid = VoxelGrid((0.5, 0.5, 0.5), 1.0, (5, 4, 4))
    domain = torch.rand(grid.shape, generator=generator) > 0.3
    centres = grid.nodes().reshape(-1, 3)
    fixed = torch.randperm(grid.count, generator=generator)[:12]
    directions = torch.nn.functional.normalize(torch.randn(12, 3, generator=generator), dim=-1)
    nothing = torch.zeros(0, 3)
    field = diffuse_directions(
        grid, domain, segments_at(centres[fixed], directions), nothing, nothing, FlowConfig(iterations=3000)
    )
    inside = domain.reshape(-1).clone()
    inside[fixed] = True
    cells = torch.nonzero(inside).squeeze(1).tolist()
    place = {cell: row for row, cell in enumerate(cells)}
    known = {int(cell): direction for cell, direction in zip(fixed, directions, strict=True)}
    matrix = torch.eye(len(cells), dtype=torch.float64)
    right = torch.zeros(len(cells), 3, dtype=torch.float64)
    reached = set(known)
    for cell in cells:
        if cell in known:
            right[place[cell]] = known[cell].double()
            continue
        x, y, z = cell // 16, cell // 4 % 4, cell % 4
        steps = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
        beside = [(x + a, y + b, z + c) for a, b, c in steps]
        near = [16 * a + 4 * b + c for a, b, c in beside if 0 <= a < 5 and 0 <= b < 4 and 0 <= c < 4]
        near = [other for other in near if other in place]
        for other in near:
            matrix[place[cell], place[other]] -= 1 / len(near)
    grown = True
    while grown:
        grown = False
        for cell in cells:
            row = matrix[place[cell]]
            if cell not in reached and any(row[place[other]] < 0 for other in reached):
                reached.add(cell)
                grown = True
    rows = [place[cell] for cell in cells if cell in reached]
    solution = torch.linalg.solve(matrix[rows][:, rows], right[rows])
    ours = field.directions.reshape(-1, 3)[[cell for cell in cells if cell in reached]].double()
    strong = solution.norm(dim=-1) > 0.05
    torch.testing.assert_close(ours[strong], torch.nn.functional.normalize(solution, dim=-1)[strong], atol=2e-3, rtol=0)


def test_the_scalp_pulls_towards_its_normal():
    grid = VoxelGrid((0.5, 0.5, 0.5), 1.0, (3, 6, 3))
    top = grid.nodes()[:, -1].reshape(-1, 3)
    along = torch.tensor([1.0, 0.0, 0.0]).expand(len(top), 3)
    scalp = grid.nodes()[:, 0].reshape(-1, 3) - torch.tensor([0.0, 0.4, 0.0])
    up = torch.tensor([0.0, 1.0, 0.0]).expand(len(scalp), 3)
    domain = torch.ones(grid.shape, dtype=torch.bool)
    angle = []
    for pull in (0.0, 0.5, 1.0):
        config = FlowConfig(normal_pull=pull, scalp_layer=0.8, iterations=400)
        field = diffuse_directions(grid, domain, segments_at(top, along), scalp, up, config)
        angle.append(float(torch.acos(field.directions[1, 0, 1, 0].clamp(-1, 1))))
    assert angle[0] < 0.05
    assert angle[0] < angle[1] < angle[2]
    assert angle[2] > 1.5


def test_pull_push_fills_an_image_as_the_layers_of_a_volume_that_repeats_it(generator):
    values, weight = torch.rand(16, 24, 3, generator=generator), (torch.rand(16, 24, generator=generator) < 0.1).float()
    layers = pull_push(values[:, :, None].expand(-1, -1, 32, -1), weight[:, :, None].expand(-1, -1, 32))
    filled = pull_push(values, weight)
    torch.testing.assert_close(layers, filled[:, :, None].expand_as(layers), atol=1e-5, rtol=1e-5)
    assert torch.equal(filled[weight > 0], values[weight > 0])


def test_pull_push_keeps_the_share_of_a_value_that_its_weight_says():
    values, weight = torch.ones(8, 8, 1), torch.ones(8, 8)
    values[3, 4], weight[3, 4] = 5.0, 0.25
    filled = pull_push(values, weight)
    # The coarse average about it: three texels of weight 1, and itself.
    around = (3 + 0.25 * 5) / 3.25
    blocks = torch.ones(4, 4)
    blocks[1, 2] = around
    doubled = torch.nn.functional.interpolate(blocks[None, None], scale_factor=2.0, mode="bilinear")[0, 0]
    assert float(filled[3, 4]) == pytest.approx(0.25 * 5 + 0.75 * float(doubled[3, 4]), abs=1e-6)
    assert torch.equal(filled[weight == 1], values[weight == 1])


def test_pull_push_keeps_what_is_known_and_fills_the_rest_within_its_range(generator):
    values = torch.rand(9, 7, 5, 2, generator=generator)
    weight = (torch.rand(9, 7, 5, generator=generator) > 0.9).float()
    filled = pull_push(values * weight[..., None], weight)
    known = weight > 0
    torch.testing.assert_close(filled[known], values[known])
    assert filled.min() >= values[known].min() - 1e-6
    assert filled.max() <= values[known].max() + 1e-6


def test_the_grid_holds_the_points_with_a_margin(generator):
    points = torch.rand(50, 3, generator=generator)
    nodes = grid_around(points, spacing=0.05, margin=0.1).nodes().reshape(-1, 3)
    assert (nodes.amin(dim=0) <= points.amin(dim=0) - 0.1 + 0.05).all()
    assert (nodes.amax(dim=0) >= points.amax(dim=0) + 0.1 - 0.05).all()


def test_a_scene_of_the_wrong_scale_is_refused():
    points = torch.tensor([[0.0, 0.0, 0.0], [40.0, 40.0, 40.0]])
    with pytest.raises(InputError, match="check the capture's scale"):
        grid_around(points, spacing=0.003, margin=0.02)
