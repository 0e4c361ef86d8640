"""A head for a capture without one: it lies where the cameras see the face, in their frame and unit."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from photographed_head import SIDE, UNIT, Scene, to_their_frame, write_scene
from PIL import Image

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import read_head
from neural_strands.capture.writer import CaptureWriter
from neural_strands.cli.main import main
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.preparation import head_of_capture
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.face.topology import LANDMARKS
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.place import cameras_in_world
from neural_strands.preparation.head.request import HeadRequest
from neural_strands.preparation.photographs.folder import read_picture
from neural_strands.preparation.photographs.metadata import ORIENTATION


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return write_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def capture(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene with its cameras in their own frame and unit, and masks of the hair."""
    folder = tmp_path_factory.mktemp("capture")
    writer, cameras = CaptureWriter(folder), cameras_in_world(scene.cameras, to_their_frame())
    for camera in cameras:
        hair = scene.hair[camera.name].astype(np.uint8) * 255
        writer.write_view(camera, scene.folder / "photos" / camera.name, torch.from_numpy(hair).float() / 255)
    writer.finish(cameras)
    return folder


def command(scene: Scene, capture: Path, out: Path, *more: str) -> list[str]:
    return ["fit-head", str(capture), str(out), "--landmarks", str(scene.folder / "landmarks.json"), *more]


def test_the_head_lies_where_the_cameras_see_it(scene: Scene, capture: Path, tmp_path: Path, capsys):
    assert main([*command(scene, capture, tmp_path, "--scale", str(UNIT)), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["landmark_error_px"] < 0.5
    head = read_head(Capture.load(capture), tmp_path / "head.obj")
    assert head is not None
    true = Mesh(to_their_frame().apply(scene.head.vertices.double()).float(), scene.head.faces)
    gap = closest_points(head.mesh.vertices, true).distance * UNIT
    assert float(gap.median()) < 1e-3
    scalp = json.loads((tmp_path / "scalp_faces.json").read_text())
    assert figures["scalp_faces"] == len(scalp)
    assert 0 < len(scalp) <= len(builtin_template().head.scalp_faces)


TAKEN = {3: Image.Transpose.ROTATE_180, 6: Image.Transpose.ROTATE_90, 8: Image.Transpose.ROTATE_270}
"""What a phone does to the upright picture before it stores it, by EXIF's orientation."""


def turned_scene(scene: Scene, folder: Path, orientation: int) -> tuple[Capture, list[list[np.ndarray]]]:
    """The scene, stored as a phone stores it, and the faces in the stored pictures.

    OpenGL cameras roll by hand, independently of the program's own turns.
    """
    marks = json.loads((scene.folder / "landmarks.json").read_text())
    angle = {3: np.pi, 6: -np.pi / 2, 8: np.pi / 2}[orientation]
    roll = np.eye(4)
    roll[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    document = json.loads((scene.folder / "transforms.json").read_text())
    (folder / "images").mkdir()
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    faces = []
    for frame in document["frames"]:
        name = Path(frame["file_path"]).name
        with Image.open(scene.folder / "photos" / name) as picture:
            picture.transpose(TAKEN[orientation]).save(folder / "images" / name, exif=exif)
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ roll).tolist()
        face = np.full((LANDMARKS, 2), np.nan)
        for number, (x, y) in marks.get(name, {}).items():
            face[int(number)] = {3: (SIDE - x, SIDE - y), 6: (y, SIDE - x), 8: (SIDE - y, x)}[orientation]
        faces.append([face] if name in marks else [])
    (folder / "transforms.json").write_text(json.dumps(document))
    return Capture.load(folder), faces


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_landmarks_by_hand_are_those_of_the_upright_photograph(scene: Scene, tmp_path: Path, orientation: int):
    capture, _ = turned_scene(scene, tmp_path, orientation)
    out = tmp_path / "out"
    assert main([*command(scene, capture.folder, out, "--scale", str(UNIT), "--no-bend")]) == 0
    found = read_head(capture, out / "head.obj")
    assert found is not None
    true = Mesh(to_their_frame().apply(scene.head.vertices.double()).float(), scene.head.faces)
    assert float(closest_points(found.mesh.vertices, true).distance.median()) * UNIT < 1e-3


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_the_detector_sees_upright_pictures(
    scene: Scene, tmp_path: Path, orientation: int, monkeypatch: pytest.MonkeyPatch
):
    capture, expected = turned_scene(scene, tmp_path, orientation)
    marks = json.loads((scene.folder / "landmarks.json").read_text())
    seen, placed = [], []

    def detect(_: Detector, pictures: list[Path]) -> list[list[np.ndarray]]:
        seen.extend(read_picture(picture) for picture in pictures)
        faces = []
        for camera in capture.cameras:
            face = np.full((LANDMARKS, 2), np.nan)
            for number, pixel in marks.get(camera.name, {}).items():
                face[int(number)] = pixel
            faces.append([face] if camera.name in marks else [])
        return faces

    def remember(calibration: object, faces: list[list[np.ndarray]], *_: object) -> None:
        placed.extend(faces)
        raise InputError("enough")

    monkeypatch.setattr(Detector, "check", lambda _: None)
    monkeypatch.setattr(Detector, "detect", detect)
    monkeypatch.setattr(head_of_capture, "fit_head", remember)
    with pytest.raises(InputError, match="enough"):
        head_of_capture.head_of_capture(capture, HeadRequest(bend=False), lambda _: None)
    for camera, picture in zip(capture.cameras, seen, strict=True):
        np.testing.assert_array_equal(picture, read_picture(scene.folder / "photos" / camera.name))
    for found, true in zip(placed, expected, strict=True):
        assert len(found) == len(true)
        np.testing.assert_allclose(found, true, atol=1e-9)


def test_what_is_there_is_kept_and_mistakes_are_told(scene: Scene, capture: Path, tmp_path: Path, capsys):
    (tmp_path / "head.obj").write_text("mine")
    assert main(command(scene, capture, tmp_path)) == 2
    assert "name another folder" in capsys.readouterr().err
    assert (tmp_path / "head.obj").read_text() == "mine"
    assert main(command(scene, capture, tmp_path / "new", "--scale", "0")) == 2
    assert "--scale: expected" in capsys.readouterr().err
    assert main(command(scene, tmp_path, tmp_path / "new")) == 2
    assert "expected transforms.json or a COLMAP model" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
