import json

import numpy as np
import pytest
import torch

from neural_strands.cli.main import main
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.lmvs.files import save_segments


@pytest.fixture
def sparse(tmp_path):
    x, y = torch.meshgrid(torch.arange(9) * 0.01, torch.linspace(0, -0.1, 10), indexing="ij")
    points = torch.stack([x, y, torch.zeros_like(x)], dim=-1)
    unit = 1e-5
    np.savez(tmp_path / "ground_truth.npz", strands=(points / unit).round().to(torch.int16).numpy(), unit=unit)
    write_groom(tmp_path / "shifted.ply", Groom.from_strands(Strands(points + torch.tensor([0.0, 0.0, 1.5e-3]))))
    write_groom(tmp_path / "big.ply", Groom.from_strands(Strands(points * 100)))
    return tmp_path


def test_json_holds_one_object_a_threshold(sparse, capsys):
    assert main(["score", str(sparse / "shifted.ply"), str(sparse / "ground_truth.npz"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert list(result) == ["1mm/10deg", "2mm/20deg", "3mm/30deg", "4mm/40deg"]
    assert result["1mm/10deg"]["f_score"] == 0
    assert result["2mm/20deg"]["precision"] == result["2mm/20deg"]["recall"] == result["2mm/20deg"]["f_score"] == 100
    assert result["2mm/20deg"]["signed"]["f_score"] == 100


def test_table_and_capture_folder_as_truth(sparse, capsys):
    assert main(["score", str(sparse / "ground_truth.npz"), str(sparse)]) == 0
    told = capsys.readouterr().out
    # Nine strands of 0.1 m, sampled every 0.5 mm, both ends included.
    assert told.startswith("9 predicted lines (strands or segments) with 1809 points, 9 true strands with 1809 points")
    lines = [line.split() for line in told.splitlines()]
    assert lines[1][:6] == ["threshold", "precision", "recall", "F", "lines", "consistency"]
    assert lines[3][:6] == ["2mm/20deg", "100.00", "100.00", "100.00", "9", "100.00"]


@pytest.mark.parametrize("suffix", [".npz", ".ply"])
def test_line_segments_of_either_sign(sparse, capsys, suffix):
    points = torch.stack([torch.zeros(20), torch.linspace(0, -0.1, 20), torch.full((20,), 5e-4)], dim=-1)
    upward = torch.tensor([0.0, 1.0, 0.0]).expand(20, 3)
    identity = torch.arange(20) // 10
    save_segments(sparse / f"segments{suffix}", LineSegments(points, upward, torch.ones(20), identity))
    assert main(["score", str(sparse / f"segments{suffix}"), str(sparse), "--json"]) == 0
    strict = json.loads(capsys.readouterr().out)["1mm/10deg"]
    assert strict["precision"] == 100
    # One of nine strands, less the gap of 1/19 of its length between the two segments.
    assert strict["recall"] == pytest.approx(100 / 9, rel=0.1)
    assert main(["score", str(sparse / f"segments{suffix}"), str(sparse)]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0].startswith("2 predicted lines (strands or segments)")
    assert told[2].split()[:2] == ["1mm/10deg", "100.00"]
    assert told[2].split()[4] == "2"
    # As npz the segments carry their own, upward, directions; a PLY is read as polylines, which run downwards.
    assert strict["signed"]["precision"] == (0 if suffix == ".npz" else 100)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["big.ply", "ground_truth.npz"], "metres"),
        (["absent.ply", "ground_truth.npz"], "absent.ply"),
        (["shifted.ply", "ground_truth.npz", "--step", "2"], "--step"),
        (["shifted.ply", "ground_truth.npz", "--head", "head.obj"], "head.obj"),
    ],
)
def test_bad_input_is_one_sentence(sparse, capsys, monkeypatch, words, message):
    monkeypatch.chdir(sparse)
    assert main(["score", *words]) == 2
    output = capsys.readouterr()
    assert message in output.err
    assert output.out == ""
