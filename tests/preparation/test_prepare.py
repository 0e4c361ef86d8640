"""The whole way from pictures to a capture, on the built-in head with a cap of hair, in a frame and unit of its own."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from full_disk import smallest_files

from neural_strands.capture.capture import Capture
from neural_strands.capture.checks import check_capture
from neural_strands.capture.head import read_head
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.preparation.cameras.calibration import write_transforms
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.builtin import builtin_template, face_paint
from neural_strands.preparation.head.place import cameras_in_world
from neural_strands.preparation.head.template import draw
from neural_strands.preparation.photographs.folder import read_picture, write_picture
from neural_strands.preparation.prepare import PrepareRequest, prepare
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.fit_similarity import Similarity

SIDE, VIEWS = 200, 9
UNIT = 0.4
"""Metres in a unit of the cameras."""


@dataclass(frozen=True)
class Scene:
    """What was photographed."""

    folder: Path
    head: Mesh
    hair: dict[str, np.ndarray]
    cameras: list[Camera]

    def request(self, out: Path, **changes) -> PrepareRequest:
        request = PrepareRequest(self.folder / "photos", out, self.folder, self.folder / "landmarks.json")
        return replace(request, **changes)


def to_their_frame() -> Similarity:
    """From the template's metres to the frame and unit of the cameras."""
    turn = 1.1
    rotation = [[1, 0, 0], [0, math.cos(turn), -math.sin(turn)], [0, math.sin(turn), math.cos(turn)]]
    return Similarity(1 / UNIT, torch.tensor(rotation).double(), torch.tensor([0.3, -1.0, 2.0]).double())


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    folder = tmp_path_factory.mktemp("scene")
    template = builtin_template()
    mesh = template.head.mesh
    scalp = mesh.faces[template.head.scalp_faces]
    shell = mesh.vertices + 0.012 * vertex_normals(mesh)
    both = Mesh(torch.cat([mesh.vertices, shell]), torch.cat([mesh.faces, scalp + len(mesh.vertices)]))
    random = np.random.default_rng(0)
    (folder / "photos").mkdir()
    marks, hair, cameras = {}, {}, []
    inside = list(INTERIOR)
    for k, turn in enumerate(np.linspace(-1.2, 1.2, VIEWS)):
        eye = torch.tensor([0.75 * math.sin(turn), 0.15, 0.75 * math.cos(turn)], dtype=torch.float32)
        camera = Camera.look_at(eye, torch.tensor([0.0, -0.03, 0.02]), 1.5 * SIDE, (SIDE, SIDE), f"{k}.png")
        body = rasterise_triangles(mesh.vertices, mesh.faces, camera)
        picture = draw(mesh, camera, body, face_paint)
        whole = rasterise_triangles(both.vertices, both.faces, camera)
        covered = (whole.face >= len(mesh.faces)).numpy()
        picture[covered] = np.clip(random.normal((90, 60, 40), 6, (int(covered.sum()), 3)), 0, 255)
        write_picture(folder / "photos" / camera.name, picture)
        hair[camera.name] = covered
        cameras.append(camera)
        if abs(turn) < 0.7:
            pixels, _ = camera.project(template.landmarks)
            marks[camera.name] = {str(i): pixels[i].tolist() for i in inside if bool(pixels[i].isfinite().all())}
    (folder / "landmarks.json").write_text(json.dumps(marks))
    theirs = to_their_frame()
    write_transforms(folder / "transforms.json", cameras_in_world(cameras, theirs))
    return Scene(folder, mesh, hair, cameras)


@pytest.fixture(scope="module")
def prepared(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict, list[str]]:
    out = tmp_path_factory.mktemp("prepared") / "capture"
    said: list[str] = []
    return out, prepare(scene.request(out), said.append), said


def test_the_head_comes_back_to_its_place(scene: Scene, prepared):
    out, figures, _ = prepared
    capture = Capture.load(out)
    head = read_head(capture)
    assert head is not None
    assert figures["metres_per_camera_unit"] == pytest.approx(UNIT, rel=0.06)
    assert 0.02 < figures["scale_error"] < 0.06
    # The world is the template's own frame but for the scale that was estimated.
    true = Mesh(scene.head.vertices * figures["metres_per_camera_unit"] / UNIT, scene.head.faces)
    gap = closest_points(head.mesh.vertices, true).distance
    assert float(gap.median()) < 1e-3
    assert figures["landmark_error_px"] < 0.5
    for camera, given in zip(capture.cameras, scene.cameras, strict=True):
        torch.testing.assert_close(camera.rotation, given.rotation, atol=5e-3, rtol=0)


def test_masks_cover_the_hair(scene: Scene, prepared):
    out, _, _ = prepared
    overlaps, missing = [], []
    for name, true in scene.hair.items():
        found = read_picture(out / "masks" / name)[..., 0] > 127
        overlaps.append((found & true).sum() / (found | true).sum())
        missing.append((true & ~found).sum() / true.sum())
    # A border of a pixel and a half is wanted: a tenth of a mask this small.
    assert np.mean(overlaps) > 0.80
    assert np.mean(missing) < 0.05


def test_the_capture_passes_its_check(prepared):
    out, figures, _ = prepared
    findings = check_capture(out)
    assert [finding for finding in findings if finding.level == "error"] == []
    assert json.loads((out / "preparation.json").read_text()) == figures
    assert 0 < figures["scalp_faces"] <= figures["template_scalp_faces"]


def test_nothing_is_done_twice(scene: Scene, prepared):
    out, figures, _ = prepared
    said: list[str] = []
    before = {path: path.stat().st_mtime_ns for path in (out / "preparation").rglob("*") if path.is_file()}
    assert prepare(scene.request(out), said.append) == figures
    assert said == [
        f"{name}: done already." for name in ("photographs", "cameras", "face", "template", "head", "masks")
    ]
    assert before == {path: path.stat().st_mtime_ns for path in (out / "preparation").rglob("*") if path.is_file()}


def test_given_masks_and_a_segmenter_are_used(scene: Scene, prepared, tmp_path: Path):
    out, _, _ = prepared
    masks = tmp_path / "masks"
    masks.mkdir()
    for name, true in scene.hair.items():
        write_picture(masks / name, true.astype(np.uint8) * 255)
    said: list[str] = []
    prepare(scene.request(out, masks=masks), said.append)
    assert "masks: done already." not in said
    for name, true in scene.hair.items():
        np.testing.assert_array_equal(read_picture(out / "masks" / name)[..., 0] > 127, true)
    prepare(scene.request(out, segmenter="cp {image} {mask}"), said.append)
    picture = read_picture(out / "masks" / "0.png")
    np.testing.assert_array_equal(picture[..., 0], read_picture(out / "images" / "0.png")[..., 0])
    with pytest.raises(InputError, match=r"expected a mask of 0\.png, found"):
        prepare(scene.request(out, segmenter="false {image} {mask}"), said.append)
    with pytest.raises(InputError, match="does not start"):
        prepare(scene.request(out, segmenter="no-such-program {image} {mask}"), said.append)
    with pytest.raises(InputError, match="expected a command with"):
        prepare(scene.request(out, segmenter="program {image}"), said.append)
    (masks / "3.png").unlink()
    with pytest.raises(InputError, match=r"found none of 3\.png"):
        prepare(scene.request(out, masks=masks), said.append)


def test_a_measured_length_makes_the_scale(scene: Scene, prepared):
    from neural_strands.preparation.head.fit import KnownSize

    out, _, _ = prepared
    figures = prepare(scene.request(out, size=KnownSize(metres_per_unit=UNIT)), lambda _: None)
    assert figures["metres_per_camera_unit"] == UNIT
    assert figures["scale_error"] == 0.0
    with pytest.raises(InputError, match="expected both irises"):
        prepare(scene.request(out, size=KnownSize(pupil_distance=0.062)), lambda _: None)


def test_what_is_the_users_is_left_alone(scene: Scene, prepared, tmp_path: Path):
    theirs = tmp_path / "theirs"
    (theirs / "images").mkdir(parents=True)
    (theirs / "images" / "a.png").write_bytes(b"mine")
    with pytest.raises(InputError, match="expected a new or empty folder"):
        prepare(scene.request(theirs), print)
    with pytest.raises(InputError, match="expected a new or empty folder"):
        prepare(scene.request(theirs / "images" / "a.png"), print)
    assert (theirs / "images" / "a.png").read_bytes() == b"mine"
    out, _, _ = prepared
    for changes in ({"photographs": out / "images"}, {"masks": out / "masks"}):
        with pytest.raises(InputError, match="expected a folder outside"):
            prepare(scene.request(out, **changes), print)


def test_a_full_disk_keeps_the_stages_that_are_done(scene: Scene, tmp_path: Path):
    out = tmp_path / "capture"
    with smallest_files(200_000), pytest.raises(InputError, match="cannot be written"):
        prepare(scene.request(out, bend=False), lambda _: None)
    assert not (out / "transforms.json").exists()
    done = {path.name for path in (out / "preparation").iterdir() if not path.name.startswith(".")}
    assert {"photographs", "cameras", "face"} <= done
    said: list[str] = []
    prepare(scene.request(out, bend=False), said.append)
    assert "face: done already." in said
