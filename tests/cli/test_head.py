"""The head command: figures of real scalps, a picture, refusals."""

import json

import pytest

from neural_strands.cli.main import main


def test_mannequin_figures_and_picture(tmp_path, capsys):
    picture = tmp_path / "chart.png"
    assert main(["head", "--roots", "100", "--picture", str(picture), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["roots"] == 100
    assert figures["overlapping_pairs"] == 0
    assert figures["scalp_pieces"] == 1
    assert 500 < figures["scalp_area_cm2"] < 800
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_table_and_refusals(tmp_path, capsys):
    assert main(["head", "--roots", "10"]) == 0
    assert "scalp area cm2" in capsys.readouterr().out
    assert main(["head", str(tmp_path / "none.obj")]) == 2
    assert "none.obj: expected a mesh file" in capsys.readouterr().err
    assert main(["head", "--roots", "0"]) == 2


@pytest.mark.parametrize("option", [["--scale", "-1"], ["--scale", "0.01"], ["--scalp", "scalp.json"]])
def test_options_of_a_mesh_are_refused_without_one(option, capsys):
    assert main(["head", *option]) == 2
    assert f"{option[0]}: expected with a head mesh, found no mesh" in capsys.readouterr().err
