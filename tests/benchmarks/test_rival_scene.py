"""The input of rivals: the person in front of a plain surround, and back in front of the photograph's."""

import json

import pytest
import torch
from tiny_capture import true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import View

PLAIN = torch.tensor([0.6, 0.0, 0.4])


@pytest.fixture(scope="module")
def scene(benchmark_module):
    return benchmark_module("rivals", "scene")


@pytest.fixture
def disc():
    """A brown disc with a soft outline before a grey surround, mixed in linear light, and a mesh out of sight."""
    view = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 100.0, (64, 64))
    away = (view.pixel_centres() - 32).norm(dim=-1)
    covered = ((20 - away) / 4 + 0.5).clamp(0, 1)
    brown, grey = torch.tensor([0.4, 0.25, 0.1]), torch.full((3,), 0.7)
    light = covered[..., None] * to_linear(brown) + (1 - covered[..., None]) * to_linear(grey)
    triangle = Mesh(torch.tensor([[0.0, 5, 0], [1, 5, 0], [0, 6, 0]]), torch.tensor([[0, 1, 2]]))
    return View(view, to_srgb(light), hair_mask=covered), triangle, covered, brown


def test_the_surround_gives_way_to_the_plain_colour(scene, disc):
    view, mesh, covered, brown = disc
    found = scene.over_plain(view, mesh, PLAIN)
    expected = covered[..., None] * brown + (1 - covered[..., None]) * PLAIN
    clear = (covered == 0) | (covered > 0.1)
    assert float((found - expected)[clear].abs().max()) < 0.01


def test_a_perfect_rival_gets_its_photograph_back(scene, disc):
    view, mesh, covered, brown = disc
    found = scene.over_surround(covered[..., None] * brown, covered, view, mesh)
    assert float((found - view.image).abs().max()) < 0.01


def test_without_a_mask_of_the_person_the_head_stands_for_it(scene, tmp_path):
    write_capture(tmp_path / "ball")
    capture = Capture.load(tmp_path / "ball")
    head = find_head(capture, None)
    covered = scene.person_coverage(capture.views_on()[0], head.mesh)
    # The ball's radius is 0.09 m, and its camera 0.783 m away: 19.7 pixels. Hair adds a little.
    assert 19.7**2 * torch.pi * 0.98 < float(covered.sum()) < 24**2 * torch.pi
    assert ((covered > 0) & (covered < 1)).any()


def test_a_part_of_the_view_has_its_principal_point_in_the_middle(scene):
    intrinsics = torch.tensor([[50.0, 0, 35], [0, 50.0, 20], [0, 0, 1]])
    part = scene.centred(Camera(intrinsics, torch.eye(4), 60, 48))
    assert (part.left, part.top, part.width, part.height) == (10, 0, 50, 40)


def test_the_scene_on_disk(scene, tmp_path, generator):
    strands = write_capture(tmp_path / "ball")
    capture = Capture.load(tmp_path / "ball")
    head, views = find_head(capture, None), capture.views_on()
    shown = [views[0], views[2]]
    seeds = scene.seed_points(true_segments(strands), head.mesh, shown, (200, 100), generator)
    assert seeds.points.shape == (300, 3)
    assert float((seeds.points[200:].norm(dim=1) - 0.09).abs().max()) < 2e-3
    # Hair that faces a camera is brown, skin is paler.
    front = seeds.points[:, 2] > 0.06
    assert seeds.colours[:200][front[:200]].mean() < 0.4 < seeds.colours[200:][front[200:]].mean()
    scene.write_scene(tmp_path / "scene", shown, head.mesh, PLAIN, seeds)
    described = json.loads((tmp_path / "scene" / "transforms.json").read_text())
    assert described["ply_file_path"] == "points.ply"
    written = Capture.load(tmp_path / "scene")
    assert [camera.name for camera in written.cameras] == ["000.png", "002.png"]
    torch.testing.assert_close(written.cameras[1].world_to_camera, shown[1].camera.world_to_camera)
    assert float((written.image(0)[0, 0] - PLAIN).abs().max()) < 1 / 255
    data = (tmp_path / "scene" / "points.ply").read_bytes()
    assert data.startswith(b"ply\nformat binary_little_endian 1.0\nelement vertex 300\n")
    assert len(data.partition(b"end_header\n")[2]) == 300 * 15
