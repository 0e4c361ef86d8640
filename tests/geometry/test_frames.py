"""Frames: orthonormal, right-handed, and inverse of each other."""

import torch

from neural_strands.geometry.frames import orthonormal_frames, to_local, to_world


def assert_rotations(frames: torch.Tensor) -> None:
    identity = torch.eye(3, dtype=frames.dtype).expand_as(frames)
    torch.testing.assert_close(frames.transpose(-1, -2) @ frames, identity, atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(frames), torch.ones(frames.shape[:-2], dtype=frames.dtype))


def test_random_frames_keep_the_normal(generator: torch.Generator):
    normals, tangents = torch.randn(2, 200, 3, generator=generator, dtype=torch.float64)
    frames = orthonormal_frames(normals, tangents)
    assert_rotations(frames)
    torch.testing.assert_close(frames[..., 2], torch.nn.functional.normalize(normals, dim=-1))
    assert ((frames[..., 0] * tangents).sum(-1) > 0).all()


def test_frame_by_hand():
    frame = orthonormal_frames(torch.tensor([0.0, 0, 2]), torch.tensor([3.0, 0, 1]))
    torch.testing.assert_close(frame, torch.eye(3))


def test_degenerate_tangents_still_make_frames():
    normals = torch.tensor([[0.0, 1, 0], [1, 0, 0], [0.6, 0.8, 0], [0, 0, -1]])
    parallel = torch.tensor([[0.0, 5, 0], [0, 0, 0], [-0.6, -0.8, 0], [0, 0, 1e-20]])
    assert_rotations(orthonormal_frames(normals, parallel))


def test_local_and_world_are_inverse(generator: torch.Generator):
    points = torch.randn(7, 5, 3, generator=generator, dtype=torch.float64)
    frames = orthonormal_frames(*torch.randn(2, 7, 3, generator=generator, dtype=torch.float64))
    local = to_local(points, points[:, 0], frames)
    torch.testing.assert_close(local[:, 0], torch.zeros(7, 3, dtype=torch.float64))
    torch.testing.assert_close(to_world(local, points[:, 0], frames), points)


def test_the_normal_is_the_third_local_axis():
    normal = torch.tensor([[0.0, 1, 0]])
    frames = orthonormal_frames(normal, torch.tensor([[1.0, 0, 0]]))
    along = to_local(torch.tensor([[[0.0, 3, 0], [2.0, 1, 0]]]), torch.tensor([[0.0, 1, 0]]), frames)
    torch.testing.assert_close(along, torch.tensor([[[0.0, 0, 2], [2, 0, 0]]]))
