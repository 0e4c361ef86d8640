"""Carving against plain numpy."""

import numpy as np
import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.visual_hull import HeadView, Silhouette, possible_points, views_that_see, visual_hull
from neural_strands.geometry.voxel_grid import VoxelGrid


def camera(x: float) -> Camera:
    return Camera.look_at(torch.tensor([x, 0.1, 1.0]), torch.zeros(3), 90.0, (60, 48))


def wall(z: float) -> Mesh:
    """A square of 0.2 m at this z."""
    corners = torch.tensor([[-0.1, -0.1, z], [0.1, -0.1, z], [0.1, 0.1, z], [-0.1, 0.1, z]])
    return Mesh(corners, torch.tensor([[0, 1, 2], [0, 2, 3]]))


@pytest.mark.parametrize("witnesses", [1, 2])
def test_points_seen_beside_the_masks_are_dropped_unless_the_head_hides_them(
    generator: torch.Generator, witnesses: int
):
    points = (torch.rand(400, 3, generator=generator) - 0.5) * 0.6
    views = [camera(x) for x in (-0.5, 0.0, 0.5)]
    masks = [torch.rand(48, 60, generator=generator) < 0.8 / witnesses for _ in views]
    index = MeshIndex(wall(0.0))
    silhouettes = [Silhouette(HeadView.of(v, index), m) for v, m in zip(views, masks, strict=True)]
    kept = possible_points(points, silhouettes, witnesses)
    found, sure = np.zeros(len(points), int), np.ones(len(points), bool)
    for view, mask in zip(views, masks, strict=True):
        centre = view.position.numpy()
        for i, point in enumerate(points.numpy()):
            seen = view.intrinsics.numpy() @ (view.world_to_camera.numpy()[:3] @ np.append(point, 1.0))
            u, v = seen[:2] / seen[2]
            if not (0 <= u < 60 and 0 <= v < 48) or mask[int(v), int(u)]:
                continue
            # Where the ray to the point meets z = 0: the wall hides what lies behind.
            share = centre[2] / (centre[2] - point[2])
            cross = centre + share * (point - centre)
            near_edge = abs(max(abs(cross[0]), abs(cross[1])) - 0.1) < 0.03
            hidden = point[2] < 0 and max(abs(cross[0]), abs(cross[1])) < 0.1
            sure[i] &= not (near_edge or abs(point[2]) < 0.01)
            found[i] += not hidden
    expected = found < witnesses
    assert sure.sum() > 50
    assert (kept.numpy() == expected)[sure].all()
    assert 0.1 < expected[sure].mean() < 0.9


@pytest.mark.parametrize("witnesses", [1, 2])
def test_nodes_and_points_are_carved_alike(device, generator: torch.Generator, request, witnesses: int):
    grid = VoxelGrid((-0.3, -0.25, -0.2), 0.04, (15, 13, 11))
    masks = [torch.rand(48, 60, generator=generator) < 0.9 / witnesses for _ in range(3)]
    index = MeshIndex(wall(0.05).to(device))
    views = [camera(x).to(device) for x in (-0.5, 0.0, 0.5)]
    silhouettes = [
        Silhouette(HeadView.of(view, index), mask.to(device)) for view, mask in zip(views, masks, strict=True)
    ]
    within = torch.rand(grid.shape, generator=generator) < 0.7
    hull = visual_hull(grid, iter(silhouettes), within.to(device), witnesses).cpu()
    possible = possible_points(grid.nodes(device).reshape(-1, 3), silhouettes, witnesses).cpu().reshape(grid.shape)
    # A GPU rounds the nodes of the kernel and those of torch differently, and some lie on the border of a pixel.
    is_real = request.node.callspec.params["device"] == "cuda"
    assert (hull != (possible & within)).float().mean() <= (0.01 if is_real else 0)
    assert 0.1 < hull.float().mean() < 0.6


def test_views_see_what_faces_them_before_the_head(device):
    index = MeshIndex(wall(0.0).to(device))
    views = [HeadView.of(camera(x).to(device), index) for x in (-0.5, 0.0, 0.5)]
    towards, away, up = torch.eye(3)[2], -torch.eye(3)[2], torch.eye(3)[1]
    points = torch.tensor([[0.0, 0.0, 0.05], [0.0, 0.0, 0.05], [0.0, 0.0, 0.05], [0.0, 0.0, -0.05], [0.0, 5.0, 0.0]])
    outward = torch.stack([towards, away, up, towards, towards])
    found = views_that_see(points.to(device), outward.to(device), views, 0.2)
    # In front of the wall; facing away; seen too much from the side; behind the wall; outside the pictures.
    assert found.tolist() == [3, 0, 0, 0, 0]
    # The middle camera, 10 cm higher and 95 cm away, sees what points upwards with a cosine of 0.105.
    assert views_that_see(points[2:3].to(device), outward[2:3].to(device), views[1:2], 0.1).tolist() == [1]
    assert views_that_see(points[2:3].to(device), outward[2:3].to(device), views[1:2], 0.11).tolist() == [0]
