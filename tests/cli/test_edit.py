"""`edit`, run as a user runs it on a small model."""

import json

import pytest
from tiny_hair import tiny_hair_model

from neural_strands.cli.main import main
from neural_strands.model.files import save_hair_model


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    folder = tmp_path_factory.mktemp("edit") / "model"
    save_hair_model(tiny_hair_model(), folder)
    return folder


def test_cut_then_apply_a_list_then_render(model, tmp_path, capsys):
    assert main(["edit", str(model), str(tmp_path / "cut"), "haircut", "--length", "0.03"]) == 0
    assert "200 strands after haircut; 200 before" in capsys.readouterr().err
    (tmp_path / "edits.json").write_text(json.dumps({"format": 1, "edits": [{"edit": "density", "strands": 90}]}))
    words = ["edit", str(tmp_path / "cut"), str(tmp_path / "sparse"), "--edits", str(tmp_path / "edits.json")]
    assert main(words) == 0
    assert "90 strands after density; 200 before" in capsys.readouterr().err
    words = [
        "render",
        str(tmp_path / "sparse"),
        "--turntable",
        "1",
        "--size",
        "32",
        "24",
        "--out",
        str(tmp_path / "png"),
    ]
    assert main(words) == 0
    assert [path.name for path in (tmp_path / "png").glob("*.png")] == ["0000.png"]


def test_hair_that_is_absent_is_one_sentence(tmp_path, capsys):
    assert main(["edit", str(tmp_path / "run"), str(tmp_path / "out"), "haircut", "--length", "0.1"]) == 2
    assert "run: expected a run, a model, edited hair or a groom file, found nothing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "expected an edit such as haircut or a list in --edits, found neither"),
        (["--edits", "edits.json", "haircut", "--length", "0.1"], "found both; give one"),
        (["haircut"], "expected one of length, fraction, plane, box, mesh, found none"),
        (["haircut", "--fraction", "2"], "haircut: fraction: expected a finite number from 0.0 to 1.0, found 2.0"),
        (["restyle"], "restyle: expected a change, found none; give --length"),
        (["blend", "--other", "absent"], "blend: absent: expected another run or its model, found nothing there"),
        (["haircut", "--unevn", "2"], "--unevn: expected an option such as --uneven"),
        (["haircut", "--uneven", "wide"], "--uneven: expected a number, found 'wide'"),
        (["haircut", "--plane", "0", "-9", "0", "0", "1", "0"], "the plane cuts off all 200 strands; move it or turn"),
        (["haircut", "--mesh", "absent.ply", "--uneven", "0"], "absent.ply"),
    ],
)
def test_refusals_are_one_sentence_and_leave_nothing(model, tmp_path, capsys, words, message):
    assert main(["edit", str(model), str(tmp_path / "out"), *words]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
