"""Cameras: closed forms by hand, and round trips."""

import math
from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.cameras import Camera, TorsoMotion, pinhole, quaternion_to_matrix, rigid_inverse


def posed(generator: torch.Generator) -> Camera:
    """A camera with skew, unequal focal lengths and a random pose, in double precision."""
    rotation = quaternion_to_matrix(torch.randn(4, generator=generator, dtype=torch.float64))
    transform = torch.eye(4, dtype=torch.float64)
    transform[:3, :3] = rotation
    transform[:3, 3] = torch.randn(3, generator=generator, dtype=torch.float64)
    intrinsics = torch.tensor([[500.0, 2.0, 310.0], [0, 480.0, 250.0], [0, 0, 1]], dtype=torch.float64)
    return Camera(intrinsics, transform, 640, 480, "posed")


def test_projection_by_hand():
    """A camera at (0, 0, 2) that looks along -z: x is to the right, and y in the world is up in the picture."""
    camera = Camera.look_at(torch.tensor([0.0, 0, 2]), torch.zeros(3), 100.0, (200, 100))
    pixels, depth = camera.project(torch.tensor([[0.0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0, 0, 1]]))
    expected = torch.tensor([[100.0, 50], [125, 50], [100, 25], [100, 50]])
    torch.testing.assert_close(pixels, expected, atol=1e-4, rtol=0)
    torch.testing.assert_close(depth, torch.tensor([2.0, 2, 2, 1]))


def test_unproject_inverts_project(generator: torch.Generator):
    camera = posed(generator)
    points = torch.randn(50, 3, generator=generator, dtype=torch.float64)
    torch.testing.assert_close(camera.unproject(*camera.project(points)), points)


def test_rays_pass_through_points(generator: torch.Generator):
    camera = posed(generator)
    pixels = 600 * torch.rand(50, 2, generator=generator, dtype=torch.float64)
    rays = camera.rays(pixels)
    torch.testing.assert_close(rays.norm(dim=-1), torch.ones(50, dtype=torch.float64))
    again, depth = camera.project(camera.position + 3.0 * rays)
    torch.testing.assert_close(again, pixels)
    assert (depth > 0).all()


def test_planes_of_rays_are_the_rays_through_pixel_centres(generator: torch.Generator):
    camera = replace(posed(generator), width=7, height=5)
    torch.testing.assert_close(camera.ray_planes().permute(1, 2, 0), camera.rays(camera.pixel_centres()))
    # Pixels of twice the side, of which the last ones reach beyond the picture.
    centres = [[[1.0 + 2 * column, 1.0 + 2 * row] for column in range(4)] for row in range(3)]
    coarse = camera.rays(torch.tensor(centres, dtype=torch.float64))
    torch.testing.assert_close(camera.ray_planes(2).permute(1, 2, 0), coarse)


def test_points_behind_have_negative_depth():
    camera = Camera.look_at(torch.tensor([0.0, 0, 2]), torch.zeros(3), 100.0, (200, 100))
    _, depth = camera.project(torch.tensor([[0.0, 0, 3]]))
    assert depth.item() == pytest.approx(-1.0)


def test_opengl_round_trip(generator: torch.Generator):
    camera = posed(generator)
    again = Camera.from_opengl(camera.opengl_camera_to_world, camera.intrinsics, (640, 480), "posed")
    torch.testing.assert_close(again.world_to_camera, camera.world_to_camera)


def test_opengl_identity_looks_along_minus_z():
    camera = Camera.from_opengl(torch.eye(4), pinhole(10.0, (4, 4)), (4, 4))
    _, depth = camera.project(torch.tensor([[0.0, 0, -5]]))
    assert depth.item() == 5.0
    torch.testing.assert_close(camera.rays(torch.tensor([[2.0, 2.0]])), torch.tensor([[0.0, 0, -1]]))


def test_colmap_by_hand():
    """A rotation by 90 degrees about x takes world (0, 0, -1) to camera (0, 1, 0)."""
    half = math.sqrt(0.5)
    quaternion, translation = torch.tensor([half, half, 0, 0]), torch.tensor([0.0, 0, 4])
    camera = Camera.from_colmap(quaternion, translation, pinhole(100.0, (20, 20)), (20, 20))
    in_camera = camera.transform(torch.tensor([[0.0, 0, -1]]))
    torch.testing.assert_close(in_camera, torch.tensor([[0.0, 1, 4]]), atol=1e-6, rtol=0)
    torch.testing.assert_close(camera.position, torch.tensor([0.0, -4, 0]), atol=1e-6, rtol=0)


def test_look_at_from_above_is_a_rotation():
    camera = Camera.look_at(torch.tensor([0.0, 3, 0]), torch.zeros(3), 100.0, (10, 10))
    torch.testing.assert_close(camera.rotation @ camera.rotation.T, torch.eye(3), atol=1e-6, rtol=0)
    assert torch.linalg.det(camera.rotation).item() == pytest.approx(1.0)
    assert camera.project(torch.zeros(1, 3))[1].item() == pytest.approx(3.0)


def test_pixel_centres_and_footprint():
    camera = Camera(pinhole(50.0, (3, 2)), torch.eye(4), 3, 2)
    centres = camera.pixel_centres()
    assert centres.shape == (2, 3, 2)
    assert centres[0, 0].tolist() == [0.5, 0.5]
    assert centres[1, 2].tolist() == [2.5, 1.5]
    assert camera.footprint(1.0) == pytest.approx(0.02)


def test_resized_view_scales_pixels(generator: torch.Generator):
    camera = posed(generator)
    points = torch.randn(20, 3, generator=generator, dtype=torch.float64)
    small = camera.resized(320, 120)
    scale = torch.tensor([0.5, 0.25], dtype=torch.float64)
    torch.testing.assert_close(small.project(points)[0], camera.project(points)[0] * scale)
    assert (small.width, small.height, small.name) == (320, 120, "posed")


def test_rigid_inverse_and_positions(generator: torch.Generator):
    camera = posed(generator)
    identity = rigid_inverse(camera.world_to_camera) @ camera.world_to_camera
    torch.testing.assert_close(identity, torch.eye(4, dtype=torch.float64))
    origin = camera.transform(camera.position[None])
    torch.testing.assert_close(origin, torch.zeros(1, 3, dtype=torch.float64))


def test_moving_devices_keeps_values(device: torch.device, generator: torch.Generator):
    camera = posed(generator).to(device)
    assert camera.intrinsics.device.type == device.type
    assert camera.world_to_camera.device.type == device.type


def test_the_room_is_seen_where_it_stands(generator: torch.Generator):
    """A point of the person moves with them; seen from the room's camera, it is where they carried it."""
    motion = posed(generator).world_to_camera
    camera = replace(posed(generator), world_to_room=motion)
    points = torch.randn(20, 3, generator=generator, dtype=torch.float64)
    carried = points @ motion[:3, :3].T + motion[:3, 3]
    for seen, expected in zip(camera.in_room().project(carried), camera.project(points), strict=True):
        torch.testing.assert_close(seen, expected)
    assert camera.in_room().world_to_room is None
    still = posed(generator)
    assert still.in_room() is still


def test_the_torso_moves_and_the_head_stays(generator: torch.Generator):
    motion = posed(generator).world_to_camera
    neck = torch.tensor([[0.0, -0.1, 0.0], [0.0, -0.2, 0.1]], dtype=torch.float64)
    torso, axis = TorsoMotion(motion, neck), neck[1] - neck[0]
    across = torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]], dtype=torch.float64)  # at right angles to the axis
    along = torch.tensor([-1.0, 0.0, 0.5, 1.0, 3.0], dtype=torch.float64)
    aside = torch.randn(len(along), 2, generator=generator, dtype=torch.float64) @ across
    points = neck[0] + along[:, None] * axis + aside
    carried = points @ motion[:3, :3].T + motion[:3, 3]
    half = (points[2] + carried[2]) / 2
    expected = torch.stack([points[0], points[1], half, carried[3], carried[4]])
    torch.testing.assert_close(torso.moved(points), expected)
    camera = replace(posed(generator), torso=torso, world_to_room=motion)
    for seen, expected in zip(
        camera.on_torso().project(points[4:]), camera.project(torso.moved(points[4:])), strict=True
    ):
        torch.testing.assert_close(seen, expected)
    assert camera.on_torso().torso is None
    assert posed(generator).on_torso().world_to_room is None
    assert camera.in_room().torso is None
    assert camera.resized(8, 8).torso is torso
