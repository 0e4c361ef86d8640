"""The kernels are compared with their plain torch versions."""

import math
from dataclasses import replace

import pytest
import torch
import warp as wp

from neural_strands.foundation import kernels as launches
from neural_strands.geometry.cameras import Camera
from neural_strands.lmvs.chains import mean_shift
from neural_strands.lmvs.consistency import LineCloud
from neural_strands.lmvs.kernels import patchmatch as patchmatch_kernels
from neural_strands.lmvs.kernels.ribbons import Patch
from neural_strands.lmvs.patchmatch import LEVELS
from neural_strands.lmvs.reference import line_cost_reference, mean_line_reference


def unit(*shape: int, generator: torch.Generator) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(*shape, 3, generator=generator), dim=-1)


def some_cameras() -> list[Camera]:
    target = torch.zeros(3)
    eyes = [[0.0, 0.0, 1.0], [0.4, 0.1, 0.9], [-0.4, 0.2, 0.9], [0.1, 0.5, 0.8]]
    return [Camera.look_at(torch.tensor(eye), target, 80.0, (48, 40)) for eye in eyes]


def projections(cameras: list[Camera]) -> torch.Tensor:
    matrix = torch.eye(4).repeat(len(cameras), 1, 1)
    for i, camera in enumerate(cameras):
        matrix[i, :3] = camera.intrinsics @ camera.world_to_camera[:3]
    return matrix


def test_line_cost_is_its_twin(generator: torch.Generator, device: torch.device):
    cameras = some_cameras()
    count = 200
    angle = torch.rand(4, 40, 48, generator=generator) * math.pi
    confidence = torch.rand(4, 40, 48, generator=generator)
    brightness = torch.rand(4, 40, 48, generator=generator)
    texture = torch.stack(
        [confidence * torch.cos(2 * angle), confidence * torch.sin(2 * angle), confidence, brightness], dim=-1
    )
    point = torch.randn(count, 3, generator=generator) * 0.06
    direction, normal = unit(count, generator=generator), unit(count, generator=generator)
    footprint = torch.full((count,), 1.0 / 80)
    patch = Patch()
    patch.along, patch.across, patch.step = 3, 1, 1.5
    patch.intensity, patch.best, patch.views, patch.height, patch.width = 0.4, 2, 3, 40, 48
    cost = torch.zeros(count, device=device)
    projection = projections(cameras)
    inputs = [
        *(launches.array(t.to(device), wp.vec3) for t in (point, direction, normal)),
        launches.array(footprint.to(device)),
        launches.array(texture.to(device).reshape(-1, 4), wp.vec4),
        launches.array(projection.to(device), wp.mat44),
        patch,
    ]
    launches.launch_split(
        patchmatch_kernels.evaluate, count, [*inputs, patchmatch_kernels.UNLIMITED, launches.array(cost)], device
    )
    expected = line_cost_reference(texture, projection, point, direction, normal, footprint, patch)
    assert torch.allclose(cost.cpu(), expected, atol=2e-3)
    assert cost.std() > 0.01
    # Within a limit a line costs the same; beyond it, it is only known to cost more.
    for limit in (float(cost.median()), 0.3 * float(cost.min())):
        limited = torch.zeros_like(cost)
        launches.launch_split(patchmatch_kernels.evaluate, count, [*inputs, limit, launches.array(limited)], device)
        within = cost <= limit
        assert torch.equal(limited[within], cost[within])
        assert (limited[~within] > limit).all()
    assert (limited < 0.9 * cost).all()


def test_perturbed_lines_stay_within_their_search_range(generator: torch.Generator, device: torch.device):
    cameras, count = some_cameras(), 300
    angle, confidence = (torch.rand(4, 40, 48, generator=generator) for _ in range(2))
    doubled = 2 * math.pi * angle
    parts = [confidence * doubled.cos(), confidence * doubled.sin(), confidence, angle]
    texture = torch.stack(parts, dim=-1).reshape(-1, 4).to(device)
    patch = Patch()
    patch.along, patch.across, patch.step = 3, 1, 1.5
    patch.intensity, patch.best, patch.views, patch.height, patch.width = 0.4, 2, 3, 40, 48
    point = torch.randn(count, 3, generator=generator) * 0.05
    centre = torch.stack([camera.position for camera in cameras])
    ray = torch.nn.functional.normalize(point - centre[0], dim=-1)
    depth = (point - centre[0]).norm(dim=-1)
    # The first have room only in front, the second only behind, the last none.
    place = torch.arange(count) // 100
    near = depth - torch.tensor([0.05, 0.0, 0.0])[place]
    far = depth + torch.tensor([0.0, 0.05, 0.0])[place]
    line, normal = unit(count, generator=generator), unit(count, generator=generator)
    state = [tensor.clone().to(device) for tensor in (depth, line, torch.full((count,), 4.0))]
    plane = torch.stack([(camera.intrinsics @ camera.rotation).T for camera in cameras])
    views = [
        launches.array(texture, wp.vec4),
        launches.array(projections(cameras).to(device), wp.mat44),
        launches.array(centre.to(device), wp.vec3),
        launches.array(plane.to(device), wp.mat33),
        patch,
    ]
    angle_of_pixel = 1.0 / 80

    def improve(trials: int) -> None:
        inputs = [
            launches.array(torch.arange(count, dtype=torch.int32, device=device)),
            launches.array(torch.full((count, 8), -1, dtype=torch.int32, device=device)),
            *(launches.array(tensor.to(device), wp.vec3) for tensor in (ray, normal)),
            *(launches.array(tensor.to(device)) for tensor in (near, far)),
            *(trials, 0.04, 0.3, 7, angle_of_pixel),
            *views,
            *(launches.array(tensor, kind) for tensor, kind in zip(state, (None, wp.vec3, None), strict=True)),
        ]
        launches.launch_split(patchmatch_kernels.improve, count, inputs, device)

    improve(0)
    begun = state[2].cpu().clone()
    improve(6)
    found, cost = state[0].cpu(), state[2].cpu()
    moved = found != depth
    assert moved.view(3, 100).sum(dim=1).tolist()[2] == 0
    assert (moved.view(3, 100).sum(dim=1)[:2] > 30).all()
    assert ((found > near) & (found < far))[moved].all()
    assert torch.equal(cost < begun, moved)
    # The cost that is kept is that of the line that is kept.
    again = torch.zeros(count, device=device)
    where = centre[0] + ray * found[:, None]
    kept = [launches.array(tensor.to(device), wp.vec3) for tensor in (where, state[1], normal)]
    footprint = launches.array((found * angle_of_pixel).to(device))
    limit = patchmatch_kernels.UNLIMITED
    inputs = [*kept, footprint, *views[:2], patch, limit, launches.array(again)]
    launches.launch_split(patchmatch_kernels.evaluate, count, inputs, device)
    torch.testing.assert_close(again.cpu(), cost, rtol=0, atol=1e-4)


def test_a_ribbon_too_large_for_the_kernels_is_refused():
    with pytest.raises(ValueError, match="at most 128 samples, found 135"):
        replace(LEVELS[0], along=13, across=2)


def test_mean_shift_is_its_twin(generator: torch.Generator):
    count = 300
    points = torch.rand(count, 3, generator=generator) * 0.02
    directions = torch.nn.functional.normalize(
        torch.tensor([0.0, 1.0, 0.0]) + 0.3 * torch.randn(count, 3, generator=generator), dim=-1
    )
    directions *= torch.sign(torch.randn(count, 1, generator=generator))
    weight = torch.rand(count, generator=generator)
    cloud = LineCloud(points, directions, weight, torch.zeros(count, dtype=torch.int64))
    moved, turned, support = mean_shift(cloud, 0.004, 30.0, 1)
    for i in range(0, count, 13):
        place, line, total = mean_line_reference(points, directions, weight, points[i], directions[i], 0.004, 30.0)
        assert torch.allclose(moved[i], place, atol=1e-6)
        assert torch.allclose(turned[i], line, atol=1e-4)
        assert abs(float(support[i]) - total) < 1e-4


def test_mean_shift_moves_across_the_line_only(generator: torch.Generator):
    count = 100
    points = torch.rand(count, 3, generator=generator) * 0.01
    directions = torch.tensor([0.0, 0.0, 1.0]).repeat(count, 1)
    cloud = LineCloud(points, directions, torch.ones(count), torch.zeros(count, dtype=torch.int64))
    moved, _, _ = mean_shift(cloud, 0.005, 20.0, 2)
    assert torch.allclose(moved[:, 2], points[:, 2], atol=1e-6)
