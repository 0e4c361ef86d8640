"""`export` and moving hair, run as a user runs them on a small model."""

import importlib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from tiny_hair import tiny_hair_model

from neural_strands.cli.main import main
from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.simulated_wind import SimulatedHair
from neural_strands.geometry.resample import resample
from neural_strands.grooms.io import read_groom
from neural_strands.model.files import save_hair_model
from neural_strands.runs.edited import open_hair


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


def test_simulated_wind_is_a_sample_per_frame(blown, tmp_path):
    words = ["wind", "--simulate", "--guides", "20", "--seconds", "0.2", "--calm", "0.05", "--fps", "12"]
    assert main(["edit", str(blown.parent / "model"), str(tmp_path / "swinging"), *words]) == 0
    assert main(["export", str(tmp_path / "swinging"), str(tmp_path / "hair.usd"), "--points", "12"]) == 0
    usd, geometry = importlib.import_module("pxr.Usd"), importlib.import_module("pxr.UsdGeom")
    stage = usd.Stage.Open(str(tmp_path / "hair.usd"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (0, 2, 12)
    written = geometry.BasisCurves(stage.GetPrimAtPath("/hair/strands")).GetPointsAttr()
    opened = open_hair(tmp_path / "swinging")
    motion = hair_motion(replace(opened.hair, strands=resample(opened.hair.strands, 12)), opened.edits)
    assert isinstance(motion, SimulatedHair)
    frames = [np.array(written.Get(frame)).reshape(200, 12, 3) for frame in range(3)]
    for frame, points in enumerate(frames):
        assert np.allclose(points, motion.at(frame / 12), atol=1e-6)
    assert np.abs(frames[2] - frames[0]).max() > 1e-3


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
