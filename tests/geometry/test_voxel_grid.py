"""The voxel grid against closed forms and its twin."""

import pytest
import torch

from neural_strands.geometry.voxel_grid import Outside, VoxelGrid, sample_reference


def test_voxels_fill_the_box_that_is_asked_for():
    grid = VoxelGrid.filling((0.0, -1.0, 2.0), (1.0, -0.5, 2.1), 0.25)
    assert grid.shape == (4, 2, 2)
    nodes = grid.nodes()
    torch.testing.assert_close(nodes[0, 0, 0], torch.tensor([0.125, -0.875, 2.125]))
    torch.testing.assert_close(nodes[-1, -1, -1], torch.tensor([0.875, -0.625, 2.375]))
    assert grid.count == nodes[..., 0].numel()


def test_an_extended_grid_has_the_same_nodes_and_fills_the_box():
    random = torch.Generator().manual_seed(0)
    for _ in range(200):
        low, size, lower, higher = torch.rand(4, 3, generator=random, dtype=torch.float64) - 0.4
        spacing = 0.01 + 0.1 * float(torch.rand(1, generator=random))
        grid = VoxelGrid.filling(low.tolist(), (low + size.abs()).tolist(), spacing)
        wanted = low + lower.clamp(max=0.2), low + size.abs() + higher
        found = grid.extended(wanted[0].tolist(), wanted[1].tolist())
        nodes, more = grid.nodes().double(), found.nodes().double()
        moved = (nodes[0, 0, 0] - more[0, 0, 0]) / spacing
        torch.testing.assert_close(moved, moved.round(), atol=1e-3, rtol=0)
        assert (moved.round() >= 0).all()
        for mine, bound, of_box in (
            (more[0, 0, 0], nodes[0, 0, 0], wanted[0]),
            (-more[-1, -1, -1], -nodes[-1, -1, -1], -wanted[1]),
        ):
            reached = mine - 0.5 * spacing
            assert (reached <= of_box + 1e-5).all()
            needed = of_box < bound - 0.5 * spacing - 1e-5
            assert (reached[needed] > of_box[needed] - spacing - 1e-5).all()
            torch.testing.assert_close(mine[~needed], bound[~needed], atol=1e-5, rtol=0)


def test_a_grid_that_fills_the_box_but_for_rounding_stays_as_it_is():
    for low in (0.1, -0.37, 0.3, 1 / 3):
        grid = VoxelGrid.filling((low, low, low), (low + 0.7, low + 0.7, low + 0.7), 0.1)
        for nudge in (0.0, 1e-9, -1e-9):
            box = [first - 0.05 + nudge for first in grid.origin], [low + 0.7 + nudge] * 3
            assert grid.extended(*box) == grid


def test_index_is_the_voxel_whose_centre_is_nearest(generator):
    grid = VoxelGrid((-0.085, 0.215, 0.015), 0.03, (4, 5, 6))
    points = torch.rand(200, 3, generator=generator) * torch.tensor([0.12, 0.15, 0.18]) + torch.tensor([-0.1, 0.2, 0.0])
    index, inside = grid.index(points)
    nearest = torch.cdist(points.double(), grid.nodes().reshape(-1, 3).double()).argmin(dim=1)
    assert inside.all()
    torch.testing.assert_close(index, nearest)


def test_points_beyond_the_box_are_not_inside():
    grid = VoxelGrid((0.05, 0.05, 0.05), 0.1, (2, 2, 2))
    _, inside = grid.index(torch.tensor([[0.1, 0.1, 0.1], [0.1, 0.1, 0.3], [-0.01, 0.1, 0.1]]))
    assert inside.tolist() == [True, False, False]


def test_a_linear_function_is_read_exactly_between_nodes(generator):
    grid = VoxelGrid((0.52, -0.18, 0.12), 0.04, (7, 5, 6))
    slope = torch.tensor([1.5, -2.0, 0.5])
    volume = grid.nodes() @ slope
    points = torch.tensor(grid.origin) + torch.rand(100, 3, generator=generator) * torch.tensor([0.24, 0.16, 0.2])
    for outside in ("border", "zero"):
        read = grid.sample(volume[..., None], points, outside)[:, 0]
        torch.testing.assert_close(read, points @ slope, atol=1e-5, rtol=1e-5)
    value, gradient = grid.sample_with_slope(volume, points)
    torch.testing.assert_close(value, points @ slope, atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(gradient, slope.expand(100, 3), atol=1e-4, rtol=0)


@pytest.mark.parametrize("outside", ["border", "zero"])
def test_samples_agree_with_the_twin(outside: Outside, device, generator):
    grid = VoxelGrid((0.1, -0.2, 0.3), 0.01, (4, 5, 6))
    values = torch.randn(4, 5, 6, 3, generator=generator)
    side = 0.01 * torch.tensor([4.0, 5.0, 6.0])
    points = torch.tensor(grid.origin) + side * (1.4 * torch.rand(3000, 3, generator=generator) - 0.2)
    found = grid.sample(values.to(device), points.to(device), outside).cpu()
    torch.testing.assert_close(found, sample_reference(grid, values, points, outside), atol=1e-5, rtol=0)


def test_slopes_agree_with_the_gradient_of_the_twin(device, generator):
    grid = VoxelGrid((0.1, -0.2, 0.3), 0.01, (4, 5, 6))
    values = torch.randn(4, 5, 6, generator=generator)
    side = 0.01 * torch.tensor([4.0, 5.0, 6.0])
    points = torch.tensor(grid.origin) + side * (1.4 * torch.rand(3000, 3, generator=generator) - 0.2)
    points.requires_grad_()
    twin = sample_reference(grid, values[..., None], points, "border")[:, 0]
    (slope,) = torch.autograd.grad(twin.sum(), points)
    found, gradient = grid.sample_with_slope(values.to(device), points.detach().to(device))
    torch.testing.assert_close(found.cpu(), twin.detach(), atol=1e-5, rtol=0)
    torch.testing.assert_close(gradient.cpu(), slope, atol=2e-3, rtol=1e-4)


def test_points_that_are_not_finite_read_something_and_harm_nothing():
    grid = VoxelGrid((0.0, 0.0, 0.0), 1.0, (3, 3, 3))
    points = torch.tensor([[float("nan"), 0.0, 0.0], [float("inf"), 1.0, 1.0], [1.0, 1.0, 1.0]])
    assert grid.sample(torch.ones(3, 3, 3, 1), points, "zero")[2] == 1.0
    assert grid.sample_with_slope(torch.ones(3, 3, 3), points)[0][2] == 1.0


def test_depth_is_the_distance_from_the_border():
    grid = VoxelGrid.filling((0.0, 0.0, 0.0), (1.0, 2.0, 3.0), 0.1)
    places = torch.tensor([[0.5, 1.0, 1.5], [0.5, 1.0, 2.8], [0.1, 1.0, 1.5], [0.5, 2.3, 1.5]])
    torch.testing.assert_close(grid.depth(places), torch.tensor([0.5, 0.2, 0.1, -0.3]))
