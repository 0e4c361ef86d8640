"""A video through all of `prepare`: the film and its landmarks give frames, cameras, head, scale and masks."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from papered_room import room, wallpaper

from neural_strands.capture.capture import Capture
from neural_strands.capture.checks import check_capture
from neural_strands.cli.main import main
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.builtin import builtin_template, face_paint
from neural_strands.preparation.head.template import draw
from neural_strands.preparation.photographs.folder import read_picture
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.fit_similarity import umeyama

SIDE, VIEWS, INTERVAL = 320, 15, 3
"""Size of a frame, number of places of the camera, and frames at each, of which one is sharp."""


@dataclass(frozen=True)
class Film:
    """A video of the built-in head with a cap of hair in a papered room.

    Attributes:
        path: the video.
        landmarks: landmarks of the face in its sharp frames.
        cameras: camera of each sharp frame, by the name that its picture should have.
        hair: where that frame shows hair.
    """

    path: Path
    landmarks: Path
    cameras: dict[str, Camera]
    hair: dict[str, np.ndarray]


def write_film(folder: Path) -> Film:
    """Walk around the front of the head; at each place, one frame is sharp and the others are blurred."""
    template = builtin_template()
    mesh = template.head.mesh
    shell = mesh.vertices + 0.012 * vertex_normals(mesh)
    faces = torch.cat([mesh.faces, mesh.faces[template.head.scalp_faces] + len(mesh.vertices)])
    both = Mesh(torch.cat([mesh.vertices, shell]), faces)
    random = np.random.default_rng(0)
    papers = [wallpaper(random) for _ in range(6)]
    film = Film(folder / "film.avi", folder / "landmarks.json", {}, {})
    writer = cv2.VideoWriter(str(film.path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (SIDE, SIDE))
    marks = {}
    for k, turn in enumerate(np.linspace(-1.2, 1.2, VIEWS)):
        eye = torch.tensor([0.75 * math.sin(turn), 0.15 + 0.1 * math.sin(3 * turn), 0.75 * math.cos(turn)])
        sharp = INTERVAL * k + k % INTERVAL
        name = f"frame_{sharp:06d}.png"
        camera = Camera.look_at(eye.float(), torch.tensor([0.0, -0.03, 0.02]), 1.5 * SIDE, (SIDE, SIDE), name)
        body = rasterise_triangles(mesh.vertices, mesh.faces, camera)
        whole = rasterise_triangles(both.vertices, both.faces, camera)
        picture = draw(mesh, camera, body, face_paint)
        covered, empty = (whole.face >= len(mesh.faces)).numpy(), (whole.face < 0).numpy()
        picture[covered] = np.clip(random.normal((90, 60, 40), 6, (int(covered.sum()), 3)), 0, 255)
        picture[empty] = room(camera, papers)[empty]
        for number in range(INTERVAL * k, INTERVAL * (k + 1)):
            shown = picture if number == sharp else cv2.GaussianBlur(picture, (0, 0), 3)
            writer.write(np.ascontiguousarray(shown[..., ::-1]))
        film.cameras[name], film.hair[name] = camera, covered
        if abs(turn) < 0.7:
            pixels, _ = camera.project(template.landmarks)
            marks[name] = {str(i): pixels[i].tolist() for i in INTERIOR if bool(pixels[i].isfinite().all())}
    writer.release()
    film.landmarks.write_text(json.dumps(marks))
    return film


@pytest.mark.slow(seconds=30)
def test_a_video_becomes_a_capture(tmp_path: Path, capsys: pytest.CaptureFixture):
    pytest.importorskip("pycolmap")
    film, out = write_film(tmp_path), tmp_path / "capture"
    arguments = ["prepare", str(film.path), str(out), "--frames", str(VIEWS), "--landmarks", str(film.landmarks)]
    assert main(arguments) == 0
    assert f"{VIEWS} of {INTERVAL * VIEWS} frames taken" in capsys.readouterr().err
    found = Capture.load(out)
    # The sharp frame of every interval, and no other.
    assert [camera.name for camera in found.cameras] == list(film.cameras)
    assert [finding for finding in check_capture(out) if finding.level == "error"] == []
    places = torch.stack([camera.position for camera in found.cameras]).double()
    true_places = torch.stack([camera.position for camera in film.cameras.values()]).double()
    to_truth = umeyama(places.numpy(), true_places.numpy(), np.ones(VIEWS))
    assert to_truth.scale == pytest.approx(1, abs=0.06)
    assert (to_truth.apply(places) - true_places).norm(dim=1).max() < 0.02
    overlaps = []
    for name, true in film.hair.items():
        mask = read_picture(out / "masks" / name)[..., 0] > 127
        overlaps.append((mask & true).sum() / (mask | true).sum())
    assert np.mean(overlaps) > 0.7
    # The same command does nothing again.
    assert main(arguments) == 0
    said = capsys.readouterr().err
    for stage in ("photographs", "matches", "model", "cameras", "face", "template", "head", "masks", "skull"):
        assert f"{stage}: already done." in said
