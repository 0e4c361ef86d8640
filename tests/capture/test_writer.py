"""Captures that are written are read back unchanged."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from full_disk import smallest_files
from hypothesis import given, settings
from hypothesis import strategies as st

from neural_strands.capture.capture import Capture
from neural_strands.capture.writer import UNIT, CaptureWriter, quantised
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera, TorsoMotion
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.head_file import read_head_file

WIDTH, HEIGHT = 12, 8


def camera(name: str, angle: float = 0.3, **changes) -> Camera:
    eye = torch.tensor([math.sin(angle), 0.2, math.cos(angle)])
    return replace(Camera.look_at(eye, torch.zeros(3), 333.3, (WIDTH, HEIGHT), name), **changes)


def samples(seed: int, channels: tuple[int, ...] = (), kind: type = np.uint8) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, np.iinfo(kind).max, (HEIGHT, WIDTH, *channels), kind, endpoint=True)


def unit(stored: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(stored.astype(np.float32) / np.float32(np.iinfo(stored.dtype).max))


def same(found: Camera, written: Camera) -> None:
    assert (found.name, found.width, found.height) == (written.name, written.width, written.height)
    assert torch.equal(found.intrinsics, written.intrinsics)
    torch.testing.assert_close(found.world_to_camera, written.world_to_camera, atol=1e-6, rtol=0)


def test_views_come_back_with_names_sub_folders_cameras_and_every_bit(tmp_path):
    views = {
        "left/0001.png": (samples(0, (3,)), samples(1), samples(2)),
        "right/0001.png": (samples(3, (3,), np.uint16), samples(4, (), np.uint16), None),
        "0001.png": (samples(5, (3,)), None, samples(6)),
    }
    cameras = [camera(name, k) for k, name in enumerate(views)]
    writer = CaptureWriter(tmp_path)
    for one, parts in zip(cameras, views.values(), strict=True):
        writer.write_view(one, *parts)
    writer.finish(cameras)
    capture = Capture.load(tmp_path)
    for k, parts in enumerate(views.values()):
        same(capture.cameras[k], cameras[k])
        found = (capture.image(k), capture.hair_mask(k), capture.person_mask(k))
        for read, written in zip(found, parts, strict=True):
            assert (read is None) == (written is None)
            assert read is None or torch.equal(read, unit(written))


def test_values_between_0_and_1_are_rounded_to_8_bits(tmp_path, generator):
    image = torch.rand(HEIGHT, WIDTH, 3, generator=generator)
    writer = CaptureWriter(tmp_path)
    writer.write_view(camera("a"), image, image[..., 0])
    writer.finish([camera("a")])
    capture = Capture.load(tmp_path)
    assert capture.cameras[0].name == "a.png"
    assert (capture.image(0) - image).abs().max() <= 0.501 / 255
    assert (capture.hair_mask(0) - image[..., 0]).abs().max() <= 0.501 / 255


def test_files_are_copied_as_they_are(tmp_path):
    # No encoder would produce these bytes: files are copied without decoding.
    (tmp_path / "photo.JPG").write_bytes(b"a photograph")
    writer = CaptureWriter(tmp_path / "capture")
    writer.write_view(camera("sub/photo.jpg"), tmp_path / "photo.JPG")
    assert (tmp_path / "capture/images/sub/photo.jpg").read_bytes() == b"a photograph"
    with pytest.raises(ValueError, match="expected a PNG file"):
        writer.write_view(camera("photo.png"), tmp_path / "photo.JPG")
    with pytest.raises(InputError, match=r"absent\.jpg: expected an image, but it cannot be read"):
        writer.write_view(camera("photo.jpg"), tmp_path / "absent.jpg")
    assert [path.name for path in (tmp_path / "capture/images").iterdir()] == ["sub"]


def test_intrinsics_stand_at_the_top_where_all_agree_and_in_frames_where_not(tmp_path):
    writer = CaptureWriter(tmp_path)
    other = camera("b.png").resized(6, 4).cropped(0, 0, 5, 4)
    writer.finish([camera("a.png"), camera("c.png", 1.0)])
    assert "fl_x" in json.loads((tmp_path / "transforms.json").read_text())
    writer.finish([camera("a.png"), other])
    document = json.loads((tmp_path / "transforms.json").read_text())
    assert "fl_x" not in document
    for found, written in zip(Capture.load(tmp_path).cameras, (camera("a.png"), other), strict=True):
        same(found, written)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-1, 1, width=32), min_size=4, max_size=4).filter(lambda q: sum(x * x for x in q) > 0.1),
    st.lists(st.floats(-3, 3, width=32), min_size=3, max_size=3),
)
def test_any_pose_comes_back_to_single_precision(tmp_path_factory, quaternion, translation):
    lens = camera("a").intrinsics
    written = Camera.from_colmap(torch.tensor(quaternion), torch.tensor(translation), lens, (WIDTH, HEIGHT), "a.png")
    folder = tmp_path_factory.mktemp("pose")
    CaptureWriter(folder).finish([written])
    found = Capture.load(folder).cameras[0]
    torch.testing.assert_close(found.world_to_camera, written.world_to_camera, atol=3e-6, rtol=0)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(0.25, 4096, width=32), min_size=2, max_size=2),
    st.lists(st.floats(-1024, 1024, width=32), min_size=2, max_size=2),
    st.sampled_from([0.0, 0.0, 1e-3, -2.5]),
)
def test_any_intrinsics_come_back_to_the_last_bit_and_skewed_ones_are_refused(tmp_path_factory, focal, centre, skew):
    rows = [[focal[0], skew, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]]
    written = camera("a.png", intrinsics=torch.tensor(rows))
    folder = tmp_path_factory.mktemp("lens")
    if skew:
        with pytest.raises(ValueError, match=r"a\.png: expected axes at right angles, found a skew of"):
            CaptureWriter(folder).finish([written])
        assert not list(folder.iterdir())
    else:
        CaptureWriter(folder).finish([written])
        same(Capture.load(folder).cameras[0], written)


def test_a_view_written_again_keeps_no_old_mask(tmp_path):
    writer = CaptureWriter(tmp_path)
    writer.write_view(camera("a.png"), samples(0, (3,)), samples(1), samples(2))
    writer.write_view(camera("a.png"), samples(3, (3,)))
    writer.finish([camera("a.png")])
    capture = Capture.load(tmp_path)
    assert capture.hair_mask(0) is None
    assert capture.person_mask(0) is None


@pytest.mark.parametrize("name", ["", "/etc/x.png", "../x.png", "a/../../x.png", "a\\x.png"])
def test_names_that_leave_the_folder_are_refused(tmp_path, name):
    with pytest.raises(ValueError, match="whose name can be a file's"):
        CaptureWriter(tmp_path / "capture").write_view(camera(name), samples(0, (3,)))
    assert not list(tmp_path.iterdir())


def test_what_the_format_cannot_say_is_refused(tmp_path):
    writer = CaptureWriter(tmp_path)
    with pytest.raises(ValueError, match="found 2 of a"):
        writer.finish([camera("a.png"), camera("a.jpg")])
    skewed = camera("a.png").intrinsics.clone()
    skewed[0, 1] = 0.5
    with pytest.raises(ValueError, match="skew"):
        writer.finish([camera("a.png", intrinsics=skewed)])
    with pytest.raises(ValueError, match="expected 12 x 8 pixels as its camera has, found 8 x 12"):
        writer.write_view(camera("a.png"), samples(0, (3,)).transpose(1, 0, 2))
    assert not list(tmp_path.iterdir())


def test_heads_come_back_to_the_last_bit(tmp_path, generator):
    plain = Mesh(torch.rand(5, 3, generator=generator), torch.tensor([[0, 1, 2], [3, 1, 4]]))
    for mesh in (plain, replace(plain, corner_uv=torch.rand(2, 3, 2, generator=generator))):
        CaptureWriter(tmp_path).write_head(mesh, torch.tensor([1]))
        CaptureWriter(tmp_path).finish([camera("a.png")])
        head = read_head_file(tmp_path / "head.obj")
        assert torch.equal(head.mesh.vertices, mesh.vertices)
        assert torch.equal(head.mesh.faces, mesh.faces)
        assert (head.mesh.corner_uv is None) == (mesh.corner_uv is None)
        if mesh.corner_uv is not None:
            assert head.mesh.corner_uv is not None
            assert torch.equal(head.mesh.corner_uv, mesh.corner_uv)
        assert head.scalp_faces.tolist() == [1]
    CaptureWriter(tmp_path).write_head(plain)
    assert read_head_file(tmp_path / "head.obj").scalp is None


@pytest.mark.parametrize("reach", [0.3, 1.8])
def test_true_strands_come_back_as_quantised(tmp_path, generator, reach):
    strands = Strands((torch.rand(20, 10, 3, generator=generator) * 2 - 1) * reach)
    rounded = quantised(strands)
    step = UNIT * math.ceil(reach / 32767 / UNIT)
    assert (rounded.points - strands.points).abs().max() <= 0.51 * step
    assert torch.equal(quantised(rounded).points, rounded.points)
    CaptureWriter(tmp_path).write_ground_truth(strands)
    CaptureWriter(tmp_path).finish([camera("a.png")])
    assert torch.equal(Capture.load(tmp_path).ground_truth.points, rounded.points)


def test_a_full_disk_leaves_nothing_half_written(tmp_path):
    writer = CaptureWriter(tmp_path)
    with smallest_files(50), pytest.raises(InputError, match="cannot be written"):
        writer.write_view(camera("a.png"), samples(0, (3,)))
    assert not list((tmp_path / "images").iterdir())


def test_the_motion_of_the_person_comes_back(tmp_path):
    motion = torch.eye(4)
    motion[:3, :3] = camera("a", 0.01).rotation
    motion[:3, 3] = torch.tensor([0.001, -0.002, 0.003])
    torso = TorsoMotion(motion, torch.tensor([[0.0, -0.1, 0.01], [0.0, -0.16, 0.02]]))
    cameras = [camera("a.png", world_to_room=motion, torso=torso), camera("b.png", 0.5)]
    for one in cameras:
        CaptureWriter(tmp_path).write_view(one, samples(0, (3,)))
    CaptureWriter(tmp_path).finish(cameras)
    moved, still = Capture.load(tmp_path).cameras
    assert moved.world_to_room is not None
    assert moved.torso is not None
    for found in (moved.world_to_room, moved.torso.motion):
        torch.testing.assert_close(found, motion, atol=1e-6, rtol=0)
    assert torch.equal(moved.torso.neck, torso.neck)
    assert still.world_to_room is None
    assert still.torso is None


def test_a_motion_that_scales_is_refused(tmp_path):
    cameras = [camera("a.png", world_to_room=2 * torch.eye(4)), camera("b.png", 0.5)]
    for one in cameras:
        CaptureWriter(tmp_path).write_view(one, samples(0, (3,)))
    CaptureWriter(tmp_path).finish(cameras)
    with pytest.raises(InputError, match="expected a rigid camera pose"):
        Capture.load(tmp_path)


def test_a_neck_without_length_is_refused(tmp_path):
    cameras = [camera("a.png", torso=TorsoMotion(torch.eye(4), torch.ones(2, 3))), camera("b.png", 0.5)]
    for one in cameras:
        CaptureWriter(tmp_path).write_view(one, samples(0, (3,)))
    CaptureWriter(tmp_path).finish(cameras)
    with pytest.raises(InputError, match="neck: expected two different points"):
        Capture.load(tmp_path)
