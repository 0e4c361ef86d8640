"""The voxel grid against closed forms."""

import pytest
import torch

from neural_strands.flow.grid import VoxelGrid
from neural_strands.foundation.errors import InputError


def test_grid_holds_the_points_with_a_margin(generator):
    points = torch.rand(50, 3, generator=generator)
    grid = VoxelGrid.around(points, spacing=0.05, margin=0.1)
    centres = grid.centres().reshape(-1, 3)
    assert (centres.amin(dim=0) <= points.amin(dim=0) - 0.1 + 0.05).all()
    assert (centres.amax(dim=0) >= points.amax(dim=0) + 0.1 - 0.05).all()
    assert grid.count == len(centres)


def test_index_is_the_voxel_whose_centre_is_nearest(generator):
    grid = VoxelGrid(torch.tensor([-0.1, 0.2, 0.0]), 0.03, (4, 5, 6))
    points = torch.rand(200, 3, generator=generator) * torch.tensor([0.12, 0.15, 0.18]) + grid.origin
    index, inside = grid.index(points)
    nearest = torch.cdist(points.double(), grid.centres().reshape(-1, 3).double()).argmin(dim=1)
    assert inside.all()
    torch.testing.assert_close(index, nearest)


def test_points_beyond_the_box_are_not_inside():
    grid = VoxelGrid(torch.zeros(3), 0.1, (2, 2, 2))
    _, inside = grid.index(torch.tensor([[0.1, 0.1, 0.1], [0.1, 0.1, 0.3], [-0.01, 0.1, 0.1]]))
    assert inside.tolist() == [True, False, False]


def test_sampling_a_linear_function_is_exact_between_centres(generator):
    grid = VoxelGrid(torch.tensor([0.5, -0.2, 0.1]), 0.04, (7, 5, 6))
    slope = torch.tensor([1.5, -2.0, 0.5])
    volume = (grid.centres() @ slope)[None]
    extent = torch.tensor([6.0, 4.0, 5.0]) * 0.04
    points = grid.origin + 0.02 + torch.rand(100, 3, generator=generator) * extent
    torch.testing.assert_close(grid.sample(volume, points)[:, 0], points @ slope, atol=1e-5, rtol=1e-5)


def test_a_scene_of_the_wrong_scale_is_refused():
    points = torch.tensor([[0.0, 0.0, 0.0], [40.0, 40.0, 40.0]])
    with pytest.raises(InputError, match="check the capture's scale"):
        VoxelGrid.around(points, spacing=0.003, margin=0.02)
