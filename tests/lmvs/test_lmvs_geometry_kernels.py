"""Kernels against closed forms: lines of known direction, chains on a circle, rays against a wall and a ball."""

import math

import torch
import warp as wp

from neural_strands.foundation import kernels as launches
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.visual_hull import head_distance
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.lmvs.chains import ChainConfig, grow_chains
from neural_strands.lmvs.consistency import LineCloud
from neural_strands.lmvs.kernels import patchmatch as patchmatch_kernels
from neural_strands.lmvs.kernels.ribbons import Patch
from neural_strands.lmvs.region import Region
from neural_strands.lmvs.search_range import SmoothHull, ray_bounds

SIZE = (48, 40)


def some_cameras() -> list[Camera]:
    eyes = [[0.0, 0.0, 1.0], [0.6, 0.1, 0.8], [-0.5, 0.3, 0.8], [0.1, 0.7, 0.7], [0.2, -0.6, 0.8]]
    return [Camera.look_at(torch.tensor(eye), torch.zeros(3), 80.0, SIZE) for eye in eyes]


def test_directions_that_all_views_see_are_found(generator: torch.Generator):
    cameras = some_cameras()
    for _ in range(12):
        point = 0.05 * torch.randn(3, generator=generator)
        line = torch.nn.functional.normalize(torch.randn(3, generator=generator), dim=0)
        if abs(float(line[2])) > 0.8:
            continue
        texture, projection = torch.zeros(len(cameras), SIZE[1], SIZE[0], 4), torch.eye(4).repeat(len(cameras), 1, 1)
        for i, camera in enumerate(cameras):
            # The angle is seen by finite differences of the camera's own projection.
            ends, _ = camera.project(torch.stack([point - 1e-3 * line, point + 1e-3 * line]))
            angle = math.atan2(float(ends[1, 1] - ends[0, 1]), float(ends[1, 0] - ends[0, 0]))
            texture[i, :, :] = torch.tensor([math.cos(2 * angle), math.sin(2 * angle), 1.0, 0.5])
            projection[i, :3] = camera.intrinsics @ camera.world_to_camera[:3]
        patch = Patch()
        patch.views, patch.width, patch.height = len(cameras) - 1, *SIZE
        offset = point - cameras[0].position
        found = torch.zeros(1, 3)
        inputs = [
            launches.array((offset / offset.norm())[None], wp.vec3),
            launches.array(texture.reshape(-1, 4), wp.vec4),
            launches.array(projection, wp.mat44),
            launches.array(torch.stack([camera.position for camera in cameras]), wp.vec3),
            launches.array(torch.stack([(c.intrinsics @ c.rotation).T for c in cameras]), wp.mat33),
            patch,
            launches.array(offset.norm()[None]),
            launches.array(found, wp.vec3),
        ]
        launches.launch_split(patchmatch_kernels.look, 1, inputs, "cpu")
        # A small weight pulls the line across the ray, by a few degrees at most.
        assert abs(float(found[0] @ line)) > math.cos(math.radians(4))


def test_chains_follow_a_circle(generator: torch.Generator):
    radius, footprint, count = 0.05, 0.001, 2000
    angle = 2 * math.pi * torch.rand(count, generator=generator)
    circle = torch.stack([angle.cos(), angle.sin(), torch.zeros(count)], dim=-1)
    tangent = torch.stack([-angle.sin(), angle.cos(), torch.zeros(count)], dim=-1)
    tangent = tangent * torch.sign(torch.randn(count, 1, generator=generator))
    cloud = LineCloud(radius * circle, tangent, torch.ones(count), torch.zeros(count, dtype=torch.int64))
    found = grow_chains(cloud, footprint, ChainConfig(), generator)
    assert len(found) > 0.5 * 2 * math.pi * radius / footprint
    assert ((found.points.norm(dim=-1) - radius).abs() < 3e-4).all()
    around = torch.stack([-found.points[:, 1], found.points[:, 0], torch.zeros(len(found))], dim=-1) / radius
    assert ((found.directions * around).sum(-1).abs() > math.cos(math.radians(3))).all()
    same = found.segment_id[1:] == found.segment_id[:-1]
    step = (found.points[1:] - found.points[:-1])[same]
    assert ((step.norm(dim=-1) - footprint).abs() < 0.3 * footprint).float().mean() > 0.95
    assert ((step * found.directions[1:][same]).sum(-1) > 0).all()


def test_rays_meet_a_wall_where_a_line_meets_a_plane(generator: torch.Generator):
    corners = torch.tensor([[-0.1, -0.1, 0.2], [0.1, -0.1, 0.2], [0.1, 0.1, 0.2], [-0.1, 0.1, 0.2]])
    mesh = MeshIndex(Mesh(corners, torch.tensor([[0, 1, 2], [0, 2, 3]])))
    camera = some_cameras()[0]
    rays = camera.rays(torch.rand(300, 2, generator=generator) * torch.tensor([48.0, 40.0]))
    distance = (0.2 - camera.position[2]) / rays[:, 2]
    cross = camera.position + rays * distance[:, None]
    inside = (cross[:, :2].abs() < 0.1).all(dim=1)
    found = head_distance(camera, rays, mesh)
    assert 20 < int(inside.sum()) < 280
    assert torch.allclose(found[inside], distance[inside], atol=1e-5)
    assert found[~inside].isinf().all()


def test_rays_enter_a_ball_where_the_sphere_lies(generator: torch.Generator):
    radius, voxel, nodes = 0.1, 0.005, 61
    steps = torch.arange(nodes) * voxel - 0.15
    x, y, z = torch.meshgrid(steps, steps, steps, indexing="ij")
    # One half on the sphere, linear across it.
    grid = (0.5 + (radius - (x**2 + y**2 + z**2).sqrt()) / (4 * voxel)).clamp(0, 1)
    hull = SmoothHull(VoxelGrid((-0.15, -0.15, -0.15), voxel, (nodes, nodes, nodes)), grid.contiguous())
    camera = some_cameras()[1]
    rays = camera.rays(torch.rand(300, 2, generator=generator) * torch.tensor([48.0, 40.0]))
    middle = -(rays @ camera.position)
    square = camera.position.square().sum() - middle**2
    region = Region(torch.zeros(3), 0.14)
    bounds = ray_bounds(camera, rays, torch.full((300,), math.inf), hull, region, 0.03)
    hit, missed = square < (radius - 2 * voxel) ** 2, square > (radius + 2 * voxel) ** 2
    entry = middle - (radius**2 - square).clamp(min=0).sqrt()
    assert 20 < int(hit.sum()) < 280
    # The search starts half a voxel before the surface.
    assert ((bounds.near + 0.5 * voxel - entry)[hit].abs() < voxel).all()
    assert (bounds.near[missed] < 0).all()
    assert torch.allclose((bounds.far - bounds.near)[hit], torch.tensor(0.03 + 0.5 * voxel), atol=1e-5)
    outward = torch.nn.functional.normalize(camera.position + rays * entry[:, None], dim=-1)
    turned = torch.nn.functional.normalize(outward - 0.5 * rays, dim=-1)
    assert ((bounds.normal * turned).sum(-1)[hit] > 0.99).all()
