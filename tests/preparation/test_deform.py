"""Deforming a template: to landmarks, to points of the skin, into outlines; without evidence it keeps its shape."""

import numpy as np
import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import vertex_normals
from neural_strands.preparation.face.topology import INTERIOR, LANDMARKS
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.deform import Evidence, deform
from neural_strands.preparation.head.template import Template, near_landmarks
from neural_strands.raster.triangles import rasterise_triangles


@pytest.fixture(scope="module")
def template() -> Template:
    return builtin_template()


def evidence(template: Template, **known) -> Evidence:
    nothing = {
        "landmarks": np.full((LANDMARKS, 3), np.nan),
        "landmark_error": np.zeros(LANDMARKS),
        "points": np.zeros((0, 3)),
        "on_face": near_landmarks(template.head.mesh.vertices, template.landmarks).numpy(),
        "cameras": [],
        "outlines": [],
    }
    return Evidence(**{**nothing, **known})


def test_nothing_moves_without_evidence(template: Template):
    bent = deform(template, evidence(template))
    torch.testing.assert_close(bent.head.mesh.vertices, template.head.mesh.vertices, atol=1e-6, rtol=0)


def test_landmarks_are_met_and_the_nape_stays(template: Template):
    marks = template.landmarks.double().numpy()
    # The face 4 mm wider on either side, 3 mm longer downwards: smooth.
    wanted = marks + np.stack([0.06 * marks[:, 0], 0.03 * marks[:, 1], 0.0 * marks[:, 2]], axis=1)
    bent = deform(template, evidence(template, landmarks=wanted))
    inside = list(INTERIOR)
    before = np.linalg.norm(marks - wanted, axis=1)[inside]
    after = np.linalg.norm(bent.landmarks.numpy() - wanted, axis=1)[inside]
    assert np.median(after) < 0.25 * np.median(before)
    moved = (bent.head.mesh.vertices - template.head.mesh.vertices).norm(dim=1)
    far = template.head.mesh.vertices[:, 2] < -0.08
    assert float(moved[far].max()) < 1e-3
    assert torch.equal(bent.head.scalp_faces, template.head.scalp_faces)


def test_one_slipped_landmark_makes_no_dent(template: Template):
    wanted = template.landmarks.double().numpy().copy()
    wanted[4] += [0.0, 0.0, 0.03]
    bent = deform(template, evidence(template, landmarks=wanted))
    assert float((bent.head.mesh.vertices - template.head.mesh.vertices).norm(dim=1).max()) < 3e-3


def test_skin_points_draw_the_face(template: Template):
    mesh = template.head.mesh
    face = near_landmarks(mesh.vertices, template.landmarks)
    points = (mesh.vertices + 0.004 * vertex_normals(mesh))[face].double().numpy()
    bent = deform(template, evidence(template, points=points))
    gain = ((bent.head.mesh.vertices - mesh.vertices) * vertex_normals(mesh)).sum(dim=1)[face]
    assert 0.002 < float(gain.median()) < 0.0045


def test_the_head_shrinks_into_its_outlines(template: Template):
    mesh = template.head.mesh
    cameras, outlines = [], []
    for turn in torch.linspace(-3.0, 2.0, 6).tolist():
        eye = torch.tensor([0.8 * np.sin(turn), 0.0, 0.8 * np.cos(turn)], dtype=torch.float32)
        camera = Camera.look_at(eye, torch.zeros(3), 300.0, (200, 200))
        smaller = rasterise_triangles(0.92 * mesh.vertices, mesh.faces, camera)
        cameras.append(camera)
        outlines.append((smaller.face >= 0).numpy())
    bent = deform(template, evidence(template, cameras=cameras, outlines=outlines))
    top = mesh.vertices[:, 1] > 0.08
    # 8 % of the crown's 12 cm, less the slack.
    assert 0.003 < float((mesh.vertices - bent.head.mesh.vertices)[top, 1].max()) < 0.012
    outside = 0.0
    for camera, outline in zip(cameras, outlines, strict=True):
        column, row = camera.project(bent.head.mesh.vertices)[0].floor().long().clamp(0, 199).unbind(dim=1)
        outside += float((~outline[row.numpy(), column.numpy()]).mean())
    assert outside / len(cameras) < 0.12
