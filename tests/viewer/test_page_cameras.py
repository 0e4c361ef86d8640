import math
from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.viewer.cameras import PageCamera, Pose, photograph_pose, start_pose
from neural_strands.viewer.layers import wxyz_of


def browser_at(pose, aspect):
    """The camera that a browser reports once it stands at a pose: its image fills the canvas."""
    eye, aim = torch.tensor(pose.position), torch.tensor(pose.look_at)
    camera = Camera.look_at(eye, aim, 100.0, (10, 10))
    return PageCamera(wxyz_of(camera), pose.position, pose.field_of_view, aspect)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.7])
def test_a_browsers_camera_fills_its_canvas(aspect):
    camera = PageCamera((1.0, 0.0, 0.0, 0.0), (0.1, 0.2, 0.3), math.pi / 2, aspect).sized(200)
    assert max(camera.width, camera.height) == 200
    assert camera.width / camera.height == pytest.approx(aspect, rel=0.01)
    torch.testing.assert_close(camera.position, torch.tensor([0.1, 0.2, 0.3]))
    # The identity looks along +z with y down; at 90 degrees the top edge is as high as the plane is far.
    pixel, depth = camera.project(torch.tensor([0.1, 0.2 - 1.0, 0.3 + 1.0]))
    torch.testing.assert_close(pixel, torch.tensor([camera.width / 2, 0.0]), atol=1e-4, rtol=0)
    assert float(depth) == pytest.approx(1.0)


def test_the_browsers_rotation_is_ours():
    made = Camera.look_at(torch.tensor([0.5, 0.3, -0.2]), torch.tensor([0.0, 0.1, 0.0]), 80.0, (40, 30))
    read = PageCamera(wxyz_of(made), tuple(made.position.tolist()), 0.5, 1.0).sized(64)
    torch.testing.assert_close(read.world_to_camera, made.world_to_camera, atol=1e-5, rtol=0)


@pytest.mark.parametrize("aspect", [0.4, 1.0, 2.0])
def test_the_first_view_shows_the_face_and_all_of_the_hair(aspect):
    points = torch.rand(500, 3, generator=torch.Generator().manual_seed(0)) * torch.tensor([0.2, 0.3, 0.2])
    pose = start_pose(points, aspect)
    assert pose.position[2] > pose.look_at[2]
    assert pose.position[0] == pytest.approx(pose.look_at[0], abs=1e-5)
    camera = browser_at(pose, aspect).sized(300)
    pixels, depth = camera.project(points)
    assert (depth > 0).all()
    assert (pixels >= 0).all()
    assert (pixels <= torch.tensor([camera.width, camera.height])).all()
    if aspect < 0.5:
        assert (pixels[:, 1] < camera.height / 2).all(), "the panel covers the lower half of a narrow window"


def test_a_page_without_anything_has_a_first_view():
    assert start_pose(torch.zeros(0, 3)).position == (0.0, 0.0, 1.0)
    assert start_pose(torch.full((4, 3), float("nan"))).position == (0.0, 0.0, 1.0)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
def test_the_canvas_holds_all_of_a_photograph(aspect):
    eye, middle = torch.tensor([0.4, 0.2, 0.6]), torch.tensor([0.0, 0.05, 0.0])
    taken = Camera.look_at(eye, middle, 120.0, (64, 48))
    shifted = taken.intrinsics.clone()
    shifted[0, 2] += 7
    taken = Camera(shifted, taken.world_to_camera, 64, 48)
    pose = photograph_pose(taken, aspect, middle)
    page = browser_at(pose, aspect)
    assert page.stands_at(pose)
    corners = torch.tensor([[0.0, 0.0], [64.0, 0.0], [0.0, 48.0], [64.0, 48.0]])
    seen, _ = page.sized(400).project(taken.unproject(corners, torch.ones(4)))
    size = torch.tensor([page.sized(400).width, page.sized(400).height])
    assert (seen > -0.5).all()
    assert (seen < size + 0.5).all()
    # No larger than needed: some corner touches the border.
    assert float(torch.cat([seen, size - seen]).min()) < 2.0


def test_a_camera_that_moved_stands_elsewhere():
    pose = Pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.4)
    page = browser_at(pose, 1.0)
    assert page.stands_at(pose)
    assert not replace(page, position=(0.0, 0.01, 1.0)).stands_at(pose)
    turned = browser_at(replace(pose, look_at=(0.05, 0.0, 0.0)), 1.0)
    assert not turned.stands_at(pose)
