"""Wrong units are said in one sentence: of the head, of all cameras, of a single camera."""

import logging

import numpy as np
import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.lmvs.region import Region, seen_radii
from neural_strands.lmvs.scale import check_head_size, check_scene, of_one_scale


def box_head(side: float, centre: float = 0.0) -> Mesh:
    corners = torch.tensor([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return Mesh(side * corners + centre, torch.tensor([[0, 1, 2], [5, 6, 7]]))


def camera(azimuth: float, distance: float = 1.0) -> Camera:
    eye = distance * torch.tensor([np.sin(azimuth), 0.2, np.cos(azimuth)], dtype=torch.float32)
    return Camera.look_at(eye, torch.zeros(3), 200.0, (100, 80), f"at {azimuth:g}")


@pytest.mark.parametrize("side", [0.01, 25.0, 250.0])
def test_a_head_in_another_unit_is_refused(side: float):
    with pytest.raises(InputError, match=r"^wrong scale: expected a head in metres.*found [^\n]*$"):
        check_head_size(box_head(side))


@pytest.mark.parametrize("side", [0.06, 0.25, 1.9])
def test_dolls_heads_and_bodies_pass(side: float):
    check_head_size(box_head(side))
    check_head_size(None)


@pytest.mark.parametrize("factor", [1e-3, 10.0, 1e3])
def test_cameras_in_another_unit_than_the_head_are_refused(factor: float):
    head = box_head(0.25)
    check_scene(Region(torch.zeros(3), 0.15), head)
    with pytest.raises(InputError, match=r"^wrong scale: expected cameras in the head's unit"):
        check_scene(Region(torch.zeros(3), 0.15 * factor), head)


def test_a_head_elsewhere_is_refused():
    with pytest.raises(InputError, match="where the cameras see the hair"):
        check_scene(Region(torch.zeros(3), 0.15), box_head(0.25, centre=2.0))


def test_without_a_head_another_unit_is_a_warning(caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        check_scene(Region(torch.zeros(3), 0.15), None)
        assert not caplog.text
        check_scene(Region(torch.zeros(3), 6.0), None)
    assert "not in metres: what the cameras look at is 12 across" in caplog.text


def test_one_camera_in_millimetres_is_named(caplog: pytest.LogCaptureFixture):
    cameras = [camera(0.0), camera(0.7), camera(1.4, distance=1000.0), camera(2.1, distance=1.5)]
    boxes = [torch.tensor([20.0, 20.0, 70.0, 60.0])] * 4
    with caplog.at_level(logging.WARNING):
        assert of_one_scale(cameras, boxes) == [True, True, False, True]
    assert "at 1.4: wrong scale" in caplog.text
    assert caplog.text.count("left out") == 1


def test_radii_are_those_of_the_pinhole():
    # A square of 40 pixels' half diagonal at focal length 200 and distance 1, 2.
    cameras = [camera(0.0, 1 / 1.04**0.5), camera(1.5, 2 / 1.04**0.5)]
    box = torch.tensor([50 - 800**0.5, 40 - 800**0.5, 50 + 800**0.5, 40 + 800**0.5])
    centre, radii = seen_radii(cameras, [box, box])
    assert torch.allclose(centre, torch.zeros(3), atol=1e-4)
    assert radii == pytest.approx([0.2, 0.4], rel=1e-3)
