"""`info` and `convert`, run as a user runs them."""

import json
import sys
from pathlib import Path
from typing import get_args

import pytest
import torch

from neural_strands.cli.commands.convert import Axis, axes_to_world
from neural_strands.cli.commands.info import unit_name
from neural_strands.cli.main import main
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import READERS, read_groom, write_groom

REAL_UNITS = {
    "straight_long/straight.hair": "unknown",  # 0.4 cm a unit
    "wavy_long/harolongo.data": "cm",
    "sintel_bob/SintelHairOriginal-sintel_hair.16points.tfx": "m",
    "sintel_guides/GEO-sintel_hair_emit.001-sintel_hair.tfx": "cm",
    "coil_swatch/70.obj": "unknown",  # a patch of a head
}


@pytest.fixture
def groom_file(tmp_path: Path) -> Path:
    """Two strands in centimetres, z up, -y front: one leaves the top of the head, one the face."""
    vertices = torch.tensor([[0.0, 0, 10], [0, 0, 11], [0, 0, 13], [0, -8, 2], [1, -8, 2], [3, -8, 2]])
    groom = Groom(vertices, torch.tensor([0, 3, 6]), root_normal=torch.tensor([[0.0, 0, 1], [0, -1, 0]]))
    write_groom(tmp_path / "in.npz", groom)
    return tmp_path / "in.npz"


def test_info_json(groom_file: Path, capsys: pytest.CaptureFixture):
    assert main(["info", str(groom_file), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["strands"] == 2
    assert facts["points"] == 6
    assert facts["bbox_min"] == [0.0, -8.0, 2.0]
    assert facts["bbox_max"] == [3.0, 0.0, 13.0]
    assert facts["length_median"] == 3.0
    assert facts["unit_guess"] == "unknown"
    assert facts["attributes"] == ["root_normal"]


def test_info_table(groom_file: Path, capsys: pytest.CaptureFixture):
    assert main(["info", str(groom_file)]) == 0
    out = capsys.readouterr().out
    assert "strands       2\n" in out
    assert "points        6 (3 to 3 per strand)\n" in out
    assert "(0, -8, 2) to (3, 0, 13)" in out


def test_a_single_root_says_nothing_of_the_unit(tmp_path: Path, capsys: pytest.CaptureFixture):
    write_groom(tmp_path / "a.obj", Groom(torch.eye(3), torch.tensor([0, 3])))
    assert main(["info", str(tmp_path / "a.obj"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["unit_guess"] == "unknown"
    assert facts["metres_per_unit_guess"] is None


@pytest.mark.parametrize(
    ("span", "unit"), [(0.2, "m"), (18.0, "cm"), (230.0, "mm"), (42.8, "unknown"), (0.0, "unknown")]
)
def test_unit_guess(span: float, unit: str):
    assert unit_name(span) == unit


@pytest.mark.parametrize("name", sorted(REAL_UNITS))
def test_real_files(name: str, shared_data: Path, capsys: pytest.CaptureFixture):
    assert main(["info", str(shared_data / "grooms" / name), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unit_guess"] == REAL_UNITS[name]


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_convert_to_metres_y_up(suffix: str, groom_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    """z up becomes y, -y front becomes z, x stays: (x, y, z) -> (x, z, -y) / 100."""
    out = tmp_path / f"out{suffix}"
    assert main(["convert", str(groom_file), str(out), "--scale", "0.01", "--up", "z", "--front=-y"]) == 0
    captured = capsys.readouterr()
    assert captured.out == ""
    found = read_groom(out)
    expected = torch.tensor(
        [[0.0, 0.10, 0], [0, 0.11, 0], [0, 0.13, 0], [0, 0.02, 0.08], [0.01, 0.02, 0.08], [0.03, 0.02, 0.08]]
    )
    torch.testing.assert_close(found.vertices, expected)
    if found.root_normal is not None:
        torch.testing.assert_close(found.root_normal, torch.tensor([[0.0, 1, 0], [0, 0, 1]]))


def test_convert_without_options_keeps_every_bit(groom_file: Path, tmp_path: Path):
    assert main(["convert", str(groom_file), str(tmp_path / "out.ply")]) == 0
    assert torch.equal(read_groom(tmp_path / "out.ply").vertices, read_groom(groom_file).vertices)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows allows links only to administrators")
def test_an_output_that_is_a_link_stays_one(groom_file: Path, tmp_path: Path):
    link, target = tmp_path / "out.ply", tmp_path / "elsewhere" / "groom"
    target.parent.mkdir()
    target.write_text("old")
    link.symlink_to(target)
    assert main(["convert", str(groom_file), str(link)]) == 0
    assert link.is_symlink()
    assert torch.equal(read_groom(link).vertices, read_groom(groom_file).vertices)
    assert [path.name for path in target.parent.iterdir()] == ["groom"]


def test_convert_points(groom_file: Path, tmp_path: Path):
    assert main(["convert", str(groom_file), str(tmp_path / "out.tfx"), "--points", "16"]) == 0
    assert read_groom(tmp_path / "out.tfx").uniform_size == 16


def test_converted_real_head_stands_upright(shared_data: Path, tmp_path: Path):
    """Roots of long straight hair lie above its tips, and the whole is as large as hair is."""
    source = shared_data / "grooms/straight_long/straight.hair"
    out = tmp_path / "out.npz"
    assert main(["convert", str(source), str(out), "--scale", "0.0042", "--up", "z", "--front", "y"]) == 0
    groom = read_groom(out)
    assert float(groom.roots[:, 1].mean()) > float(groom.vertices[groom.offsets[1:] - 1][:, 1].mean()) + 0.1
    assert 0.2 < float(groom.lengths().median()) < 0.5


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--up", "z", "--front=-z"], "two different axes"),
        (["--scale", "0"], "--scale"),
        (["--scale", "nan"], "--scale"),
        (["--points", "1"], "--points"),
    ],
)
def test_options_that_make_no_sense(
    arguments: list[str], words: str, groom_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture
):
    assert main(["convert", str(groom_file), str(tmp_path / "out.ply"), *arguments]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out.ply").exists()


def test_a_bad_file_leaves_the_old_output(tmp_path: Path, capsys: pytest.CaptureFixture):
    (tmp_path / "bad.hair").write_bytes(b"HAIR" + b"\xff" * 300)
    (tmp_path / "out.ply").write_bytes(b"precious")
    assert main(["convert", str(tmp_path / "bad.hair"), str(tmp_path / "out.ply")]) == 2
    err = capsys.readouterr().err
    assert "bad.hair: byte 128" in err
    assert "Traceback" not in err
    assert (tmp_path / "out.ply").read_bytes() == b"precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bad.hair", "out.ply"]


def test_unknown_output_is_refused_before_reading(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(["convert", str(tmp_path / "none.hair"), str(tmp_path / "out.abc")]) == 2
    assert "out.abc: expected a groom with one of" in capsys.readouterr().err


@pytest.mark.parametrize("up", get_args(Axis))
def test_axes_make_a_rotation(up: Axis):
    for front in get_args(Axis):
        if front[-1] != up[-1]:
            turn = axes_to_world(up, front)
            torch.testing.assert_close(turn @ turn.T, torch.eye(3))
            assert float(torch.linalg.det(turn)) == pytest.approx(1.0)
