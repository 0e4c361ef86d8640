"""Cameras on a circle: their positions, and that they see what is in the middle."""

import pytest
import torch

from neural_strands.geometry.turntable import turntable_cameras


def test_all_points_are_seen_and_the_first_camera_is_in_front():
    points = torch.rand(50, 4, 3, generator=torch.Generator().manual_seed(1)) - 0.5
    cameras = turntable_cameras(points, 8, (64, 48))
    assert cameras[0].position[2] > points[..., 2].max()
    assert cameras[2].position[0] > points[..., 0].max()
    for camera in cameras:
        pixels, depth = camera.project(points)
        assert (depth > 0).all()
        inside = ((pixels > 0) & (pixels < torch.tensor([64, 48]))).all(dim=-1)
        assert inside.float().mean() > 0.97


def test_nothing_to_turn_around_is_refused():
    with pytest.raises(ValueError, match="expected strands with finite points"):
        turntable_cameras(torch.full((3, 2, 3), torch.nan), 4, (8, 8))
