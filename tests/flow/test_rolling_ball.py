"""A ball that rolls about solid voxels, against brute force over its centres and against known shapes."""

import torch

from neural_strands.flow.rolling_ball import BallConfig, behind_ball, crowded
from neural_strands.geometry.voxel_grid import VoxelGrid

SPACING = 0.002


def box(half: float) -> VoxelGrid:
    return VoxelGrid.filling((-half,) * 3, (half,) * 3, SPACING)


def test_places_behind_the_ball_are_those_that_no_free_ball_covers(generator):
    grid = box(0.014)
    solid = (torch.rand(grid.shape, generator=generator) < 0.03) & (grid.nodes().norm(dim=-1) < 0.008)
    radius = 0.01
    found = behind_ball(grid, solid, BallConfig(radius=radius, margin=0.0))
    # Every place is tested against balls at all centres of a wide lattice that keep off the solid voxels.
    axis = torch.arange(-0.026, 0.026, SPACING) + 0.5 * SPACING
    centres = torch.cartesian_prod(axis, axis, axis)
    stones, nodes = grid.nodes()[solid], grid.nodes().reshape(-1, 3)
    # Joined voxels and the lattice make the surface uncertain by about their diagonals.
    slack = 0.004
    clear = torch.cdist(centres, stones).amin(dim=1)
    covered = torch.cdist(nodes, centres[clear > radius + slack]).amin(dim=1) < radius - slack
    reachable = torch.cdist(nodes, centres[clear > radius - slack]).amin(dim=1) < radius + slack
    assert len(stones) > 5
    assert covered.any()
    assert not found.reshape(-1)[covered].any()
    assert found.reshape(-1)[~reachable].all()
    assert found[solid].all()


def test_a_shell_with_gaps_is_filled_and_what_lies_farther_out_is_not(generator):
    grid = box(0.06)
    height = grid.nodes().norm(dim=-1)
    shell = ((height - 0.04).abs() < SPACING) & (torch.rand(grid.shape, generator=generator) < 0.05)
    found = behind_ball(grid, shell, BallConfig(radius=0.1, margin=0.004))
    assert found[height < 0.039].all()
    assert not found[height > 0.05].any()
    thin = behind_ball(grid, shell, BallConfig(radius=0.1, margin=0.0))
    outside = found & (height > 0.041)
    assert outside.any()
    assert (thin & outside).sum() < 0.5 * outside.sum()


def test_a_small_ball_enters_where_a_large_one_does_not():
    grid = box(0.05)
    nodes = grid.nodes()
    # Two walls, 3 cm apart.
    walls = (nodes[..., 0].abs() - 0.015).abs() < SPACING
    between = (nodes[..., 0].abs() < 0.01) & (nodes[..., 1].abs() < 0.02) & (nodes[..., 2].abs() < 0.02)
    assert behind_ball(grid, walls, BallConfig(radius=0.1, margin=0.0))[between].all()
    assert not behind_ball(grid, walls, BallConfig(radius=0.008, margin=0.0))[between].all()


def test_without_anything_solid_the_ball_reaches_every_place():
    grid = box(0.01)
    assert not behind_ball(grid, torch.zeros(grid.shape, dtype=torch.bool), BallConfig()).any()


def test_strays_are_not_crowded():
    grid = box(0.02)
    # Three points within a voxel of each other, and four.
    few = torch.tensor([-0.009, -0.009, -0.009]) + 0.001 * torch.eye(3)
    many = torch.tensor([0.009, 0.009, 0.009]) + 0.001 * torch.cat([torch.eye(3), -torch.eye(3)[:1]])
    found = crowded(grid, torch.cat([few, many]), 4)
    assert not found[grid.nodes()[..., 0] < 0].any()
    index, _ = grid.index(many)
    assert found.reshape(-1)[index].all()
    assert int(found.sum()) == len(index.unique())
