"""From bare photographs to a groom: cameras, head, scale and masks are all recovered."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from papered_room import room, wallpaper

from neural_strands.capture.capture import Capture
from neural_strands.cli.main import main
from neural_strands.evaluation.geometry_metrics import score_geometry
from neural_strands.evaluation.oriented_points import sample_strands
from neural_strands.geometry.cameras import Camera
from neural_strands.grooms.io import read_groom
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.builtin import builtin_template, with_mean_skull
from neural_strands.preparation.head.template import bust
from neural_strands.preparation.photographs.folder import write_picture
from neural_strands.scalp.fit_similarity import umeyama
from neural_strands.scalp.head import Head
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis.groom import make_groom
from neural_strands.synthesis.path_tracer import PathTracer, TracingConfig
from neural_strands.synthesis.styles import MELANIN, STYLES

SIDE, VIEWS, STRANDS = 256, 30, 8000


def orbit() -> list[Camera]:
    """Cameras around the head, at varying heights."""
    cameras = []
    for k in range(VIEWS):
        turn = 2 * math.pi * k / VIEWS
        eye = torch.tensor([0.8 * math.sin(turn), 0.15 + 0.15 * math.sin(3 * turn), 0.8 * math.cos(turn)])
        cameras.append(Camera.look_at(eye, torch.tensor([0.0, 0.0, 0.0]), 1.6 * SIDE, (SIDE, SIDE), f"{k:02d}"))
    return cameras


def narrow_person() -> Head:
    """A person with the template's face and skull, but with the narrow shoulders of the mannequin."""
    head = bust(mannequin())
    return replace(head, mesh=replace(head.mesh, vertices=with_mean_skull(head.mesh.vertices)))


@pytest.mark.timeout(3000)
@pytest.mark.slow(seconds=190)
def test_bare_photographs_become_a_groom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pycolmap")
    pytest.importorskip("mitsuba")
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    person_head, landmarks_of_person, cameras = narrow_person(), builtin_template().landmarks, orbit()
    black = MELANIN["black"]
    truth = make_groom(person_head, STYLES["short"], black, STRANDS, torch.Generator().manual_seed(0))
    # Black hair absorbs the light of longer paths, which would change the mean by a thousandth.
    tracing = TracingConfig(samples=4, mask_samples=4, depth=4, pigments=1, passes=2, melanin=black)
    tracer = PathTracer(person_head, truth, tracing, torch.Generator().manual_seed(0))
    random = np.random.default_rng(0)
    papers = [wallpaper(random) for _ in range(6)]
    marks = {}
    (tmp_path / "photos").mkdir()
    for k, camera in enumerate(cameras):
        person = tracer.coverage(camera)[..., 1:].numpy()
        picture = person * tracer.image(camera, k).numpy() * 255 + (1 - person) * room(camera, papers)
        write_picture(tmp_path / "photos" / f"{camera.name}.png", picture.round().astype(np.uint8))
        if camera.position[2] > 0.6:
            pixels, _ = camera.project(landmarks_of_person)
            marks[f"{camera.name}.png"] = {str(i): pixels[i].tolist() for i in INTERIOR}
    (tmp_path / "landmarks.json").write_text(json.dumps(marks))
    capture, run = str(tmp_path / "capture"), tmp_path / "run"
    landmarks = ["--landmarks", str(tmp_path / "landmarks.json")]
    assert main(["prepare", str(tmp_path / "photos"), capture, *landmarks]) == 0
    # First strands are close already, and with the preset's voxels, tracing them takes longer than these steps.
    quick = ["--config.steps", "10", "--config.strands", "4000", "--config.initial.flow.spacing", "0.004"]
    assert main(["fit", capture, str(run), "--preset", "demo", *quick]) == 0
    found = Capture.load(Path(capture))
    assert len(found) == VIEWS
    places = torch.stack([camera.position for camera in found.cameras]).double()
    true_places = torch.stack([camera.position for camera in cameras]).double()
    to_truth = umeyama(places.numpy(), true_places.numpy(), np.ones(VIEWS))
    assert to_truth.scale == pytest.approx(1, abs=0.05)
    assert (to_truth.apply(places) - true_places).norm(dim=1).max() < 0.02
    groom = read_groom(run / "groom.npz").strands()
    scores = score_geometry(sample_strands(to_truth.apply(groom.points)), sample_strands(truth.points))
    f_scores = {score.threshold.name: score.unsigned.f_score for score in scores}
    assert f_scores["2mm/20deg"] > 30
    assert f_scores["4mm/40deg"] > 65
