"""Every command that reads a head finds the same scalp on a head of polygons."""

import json
import math

import numpy as np
import pytest
import torch
from tiny_capture import RADIUS, combed_strands, write_capture

from neural_strands.cli.main import main
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.scalp.head_file import HeadFile

RINGS, AROUND, SCALP_RINGS = 16, 24, 7
"""Quads from cap to cap, quads around, and the number of rings of quads below the upper cap that are scalp."""


def quad_head(folder):
    """A ball whose caps are 24-gons and whose rings are quads, numbered from the lower cap upwards."""
    polar = np.linspace(math.pi, 0, RINGS + 2)[1:-1]
    turn = 2 * math.pi * np.arange(AROUND) / AROUND
    ball = [(math.sin(p) * math.sin(t), math.cos(p), math.sin(p) * math.cos(t)) for p in polar for t in turn]
    lines = [f"v {RADIUS * x:.9f} {RADIUS * y:.9f} {RADIUS * z:.9f}" for x, y, z in ball]
    faces = [list(range(AROUND))[::-1]]
    for ring in range(RINGS - 1):
        for k in range(AROUND):
            a, b = ring * AROUND + k, ring * AROUND + (k + 1) % AROUND
            faces.append([a, b, b + AROUND, a + AROUND])
    faces.append([(RINGS - 1) * AROUND + k for k in range(AROUND)])
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    (folder / "head.obj").write_text("\n".join(lines) + "\n")
    scalp = list(range(len(faces) - 1 - SCALP_RINGS * AROUND, len(faces)))
    (folder / "scalp_faces.json").write_text(json.dumps(scalp))
    return folder / "head.obj"


def scalp_area():
    """The area in square metres: trapezia between the polygons of the rings, and the regular polygon on top."""
    step = math.pi / (RINGS + 1)
    polar = [step * (k + 1) for k in range(SCALP_RINGS + 1)]
    chord = [2 * RADIUS * math.sin(p) * math.sin(math.pi / AROUND) for p in polar]
    middle = [(RADIUS * math.sin(p) * math.cos(math.pi / AROUND), RADIUS * math.cos(p)) for p in polar]
    rings = sum(
        AROUND * 0.5 * (chord[k] + chord[k + 1]) * math.dist(middle[k], middle[k + 1]) for k in range(SCALP_RINGS)
    )
    return rings + 0.5 * AROUND * (RADIUS * math.sin(polar[0])) ** 2 * math.sin(2 * math.pi / AROUND)


@pytest.fixture
def capture(tmp_path):
    write_capture(tmp_path / "ball")
    quad_head(tmp_path / "ball")
    (tmp_path / "other").mkdir()
    quad_head(tmp_path / "other")
    write_groom(tmp_path / "groom.npz", Groom.from_strands(Strands(combed_strands())))
    return tmp_path


@pytest.fixture
def read(monkeypatch):
    """Record every head that is read from files, whichever command reads it."""
    found, make = [], HeadFile.__init__

    def record(self, *arguments, **named):
        make(self, *arguments, **named)
        found.append(self)

    monkeypatch.setattr(HeadFile, "__init__", record)
    return found


def assert_read(read, area):
    assert read
    for head in read:
        assert head.scalp_area == pytest.approx(area, rel=1e-5)
    read.clear()


@pytest.mark.parametrize("given", [False, True])
def test_commands_on_a_capture_see_the_same_scalp(capture, read, capsys, given):
    """Each command except `check` then fails, in one sentence, at the next input that is missing."""
    ball, area = str(capture / "ball"), scalp_area()
    head = ["--head", str(capture / "other" / "head.obj")] if given else []
    if given:
        (capture / "ball" / "head.obj").unlink()
    assert main(["check", ball, *head, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["findings"]
    assert f", {1e4 * area:.0f} cm² of scalp" in next(row["message"] for row in rows if row["topic"] == "head")
    assert_read(read, area)
    assert main(["fit", ball, str(capture / "run"), *head, "--segments", str(capture / "none.npz")]) == 2
    assert_read(read, area)
    assert main(["lmvs", ball, str(capture / "out"), *head, "--views", "0"]) == 2
    assert_read(read, area)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert "none.npz" in told[0]
    assert "at least two views" in told[1]


def test_commands_that_take_a_head_see_the_same_scalp(capture, read, capsys):
    head, area = str(capture / "other" / "head.obj"), scalp_area()
    assert main(["head", head, "--roots", "50", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scalp_area_cm2"] == pytest.approx(1e4 * area, abs=0.06)
    assert_read(read, area)
    groom, ball = str(capture / "groom.npz"), str(capture / "ball")
    assert main(["score", groom, ball, "--head", head, "--json"]) == 0
    # The roots stand a millimetre off the ball, above the scalp; its flat faces lie up to 1.2 mm below the ball.
    assert 1e-3 <= json.loads(capsys.readouterr().out)["head"]["root_distance_max_m"] < 2.2e-3
    assert_read(read, area)
    assert main(["prior-report", groom, "--head", head, "--curves", "100", "--device", "cpu", "--json"]) == 0
    assert_read(read, area)
    assert main(["prior-report", ball, "--curves", "100", "--device", "cpu", "--json"]) == 0
    assert_read(read, area)
    capsys.readouterr()
    words = ["train-prior", str(capture / "p.safetensors"), "--groom", groom, "--head", head, "--config.batch", "0"]
    assert main(words) == 2
    assert_read(read, area)
    assert main(["synthesize", str(capture / "made"), "--head", head, "--strands", "1"]) == 2
    assert_read(read, area)
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 2
    assert "--config.batch" in told[0]
    assert "strands" in told[1]


def test_the_head_of_a_run_has_the_same_scalp(capture, read):
    from neural_strands.fitting.config import FitConfig
    from neural_strands.runs.run_folder import RunDescription, RunFolder, write_description

    area = scalp_area()
    for head in ("", str(capture / "other" / "head.obj")):
        described = RunDescription(str(capture / "ball"), head, "", FitConfig(), "")
        write_description(RunFolder(capture / "run"), described)
        # There is no model beside the description.
        assert main(["evaluate", str(capture / "run")]) == 2
        assert_read(read, area)


@pytest.mark.parametrize("factor", [100.0, 0.001])
def test_a_head_that_is_not_in_metres_is_refused_in_one_sentence(capture, capsys, factor):
    path = capture / "other" / "head.obj"
    lines = path.read_text().splitlines()
    vertices = [[factor * float(x) for x in line.split()[1:]] for line in lines if line.startswith("v ")]
    scaled = ["v {} {} {}".format(*vertex) for vertex in vertices] + [line for line in lines if line.startswith("f ")]
    path.write_text("\n".join(scaled) + "\n")
    ball, groom, head = str(capture / "ball"), str(capture / "groom.npz"), ["--head", str(path)]
    assert main(["check", ball, *head]) == 2
    assert "ERROR    scale" in capsys.readouterr().out
    for command in (
        ["fit", ball, str(capture / "run")],
        ["lmvs", ball, str(capture / "out")],
        ["score", groom, ball],
        ["prior-report", groom],
    ):
        assert main([*command, *head]) == 2
        told = capsys.readouterr()
        assert told.err.count("\n") == 1
        assert "wrong scale: expected a head in metres" in told.err
    assert not (capture / "run").exists()
    if factor > 1:
        # Without a frame, the unit is guessed.
        assert main(["head", str(path), "--roots", "10", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["scalp_area_cm2"] == pytest.approx(1e4 * scalp_area(), abs=0.1)


def test_the_oracle_is_of_the_quads(tmp_path):
    """If triangles were counted, the same numbers would name a belt around the middle of the ball."""
    from neural_strands.scalp.mesh_file import read_mesh_file

    source = read_mesh_file(quad_head(tmp_path))
    scalp = json.loads((tmp_path / "scalp_faces.json").read_text())
    corners = source.mesh.corners()[torch.tensor(scalp)]
    belt = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=-1).sum()
    assert abs(float(belt) / scalp_area() - 1) > 0.3
