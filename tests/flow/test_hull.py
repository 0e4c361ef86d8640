"""The hull of a ball of hair seen from many sides."""

import torch

from neural_strands.flow.hull import HullConfig, covered_volume, hair_hull
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.geometry.voxel_grid import VoxelGrid

AWAY = Mesh(torch.tensor([[9.0, 9.0, 9.0], [9.1, 9.0, 9.0], [9.0, 9.1, 9.0]]), torch.tensor([[0, 1, 2]]))
"""A head that is nowhere near."""


def views_of_ball(radius, count=12):
    views = []
    for k in range(count):
        angle = torch.tensor(2 * torch.pi * k / count)
        height = 0.3 if k % 2 else -0.3
        eye = torch.stack([angle.sin(), torch.tensor(height), angle.cos()])
        camera = Camera.look_at(eye, torch.zeros(3), 200.0, (64, 64))
        rays = camera.rays(camera.pixel_centres())
        along = -(rays @ eye)
        nearest = (eye + along[..., None] * rays).norm(dim=-1)
        views.append((camera, (nearest < radius).float()))
    return views


def before(head, views):
    index = MeshIndex(head)
    return [(HeadView.of(camera, index), mask) for camera, mask in views]


def test_hull_holds_the_ball_and_little_else():
    grid = VoxelGrid((-0.155, -0.155, -0.155), 0.01, (32, 32, 32))
    hull = hair_hull(grid, before(AWAY, views_of_ball(0.1)), AWAY, HullConfig(mask_margin=0.0))
    distance = grid.nodes().norm(dim=-1)
    assert hull[distance < 0.095].all()
    beside = (distance > 0.125) & (grid.nodes()[..., 1].abs() < 0.05)
    assert hull[beside].float().mean() < 0.05


def test_what_a_head_hides_is_not_proven_empty():
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 200.0, (64, 64))
    empty = torch.zeros(64, 64)
    wall = Mesh(
        torch.tensor([[-1.0, -1.0, 0.05], [1.0, -1.0, 0.05], [1.0, 1.0, 0.05], [-1.0, 1.0, 0.05]]),
        torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    grid = VoxelGrid((-0.095, -0.095, -0.095), 0.01, (20, 20, 20))
    hull = hair_hull(grid, before(wall, [(camera, empty)]), wall, HullConfig(head_depth=1.0))
    depth = grid.nodes()[..., 2]
    assert hull[depth < 0.04].all()
    assert not hull[depth > 0.06].any()


def test_volume_without_masks_lies_between_points_and_head():
    floor = Mesh(
        torch.tensor([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 0.0, -1.0]]),
        torch.tensor([[0, 1, 2], [0, 2, 3]]),
    )
    points = torch.tensor([[0.0, 0.05, 0.0]])
    grid = VoxelGrid((-0.045, -0.015, -0.045), 0.01, (10, 10, 10))
    volume = covered_volume(grid, points, floor)
    centres = grid.nodes()[volume]
    assert volume.any()
    assert (centres[:, [0, 2]].abs() <= 0.021).all()
    assert (centres[:, 1] < 0.07).all()
    assert (centres[:, 1] > -0.011).all()
