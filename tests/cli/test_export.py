"""`export` and moving hair, run as a user runs them on a small model."""

import cv2
import pytest
from tiny_hair import tiny_hair_model

from neural_strands.cli.main import main
from neural_strands.grooms.io import read_groom
from neural_strands.model.files import save_hair_model


@pytest.fixture(scope="module")
def blown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    save_hair_model(tiny_hair_model(), folder / "model")
    words = ["wind", "--seconds", "0.25", "--fps", "12", "--direction", "0", "0", "1"]
    assert main(["edit", str(folder / "model"), str(folder / "blown"), *words]) == 0
    return folder / "blown"


def test_export_writes_coloured_strands(blown, tmp_path, capsys):
    assert main(["export", str(blown), str(tmp_path / "hair.usd"), "--points", "12", "--guides", "20"]) == 0
    assert "200 strands of 12 points" in capsys.readouterr().err
    groom = read_groom(tmp_path / "hair.usd")
    assert groom.color is not None
    assert groom.root_uv is not None
    assert groom.uniform_size == 12


def test_a_groom_alone_can_be_exported(blown, tmp_path):
    assert main(["export", str(blown / "groom.npz"), str(tmp_path / "hair.glb")]) == 0
    assert (tmp_path / "hair.glb").stat().st_size > 200 * 20 * 12


def test_moving_hair_is_a_video(blown, tmp_path):
    words = ["render", str(blown), "--turntable", "2", "--size", "48", "32", "--out", str(tmp_path / "hair.mp4")]
    assert main(words) == 0
    video = cv2.VideoCapture(str(tmp_path / "hair.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert round(video.get(cv2.CAP_PROP_FPS)) == 12


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["hair.blend"], "expected a groom with one of .usd"),
        (
            ["hair.abc", "--blender", "no/python"],
            "no/python: expected a Python with Blender's module bpy, found no file",
        ),
        (["hair.usd", "--points", "1"], "--points: expected a whole number from 2 to 10000, found 1"),
        (["hair.usd", "--guides", "-1"], "--guides: expected a whole number from 0"),
    ],
)
def test_refusals_are_one_sentence(blown, tmp_path, capsys, words, message):
    assert main(["export", str(blown), str(tmp_path / words[0]), *words[1:]]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
