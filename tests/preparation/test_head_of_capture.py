"""A head for a capture without one: it lies where the cameras see the face, in their frame and unit."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from photographed_head import UNIT, Scene, to_their_frame, write_scene

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import read_head
from neural_strands.capture.writer import CaptureWriter
from neural_strands.cli.main import main
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.place import cameras_in_world


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
