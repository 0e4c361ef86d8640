"""Normals of a volume of voxels against those of the smooth shape that it samples."""

import math

import torch

from neural_strands.flow.surface import surface_normals
from neural_strands.geometry.voxel_grid import VoxelGrid


def test_normals_point_out_of_a_cylinder():
    grid = VoxelGrid.filling((-0.06, -0.1, -0.06), (0.06, 0.1, 0.06), 0.002)
    domain = grid.nodes()[..., [0, 2]].norm(dim=-1) < 0.04
    around = torch.linspace(0, 2 * math.pi, 50)
    expected = torch.stack([around.cos(), torch.zeros(50), around.sin()], dim=1)
    found = surface_normals(grid, domain, 0.039 * expected)
    assert ((found * expected).sum(dim=1) > math.cos(math.radians(8))).all()


def test_normals_of_a_slope_are_those_of_the_plane_not_of_the_stairs():
    grid = VoxelGrid.filling((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05), 0.002)
    slope = torch.nn.functional.normalize(torch.tensor([1.0, 0.4, 0.2]), dim=0)
    domain = grid.nodes() @ slope < 0
    surface = domain & (grid.nodes() @ slope > -0.003) & (grid.nodes().abs() < 0.03).all(dim=-1)
    found = surface_normals(grid, domain, grid.nodes()[surface])
    assert len(found) > 100
    assert (found @ slope > math.cos(math.radians(8))).all()
