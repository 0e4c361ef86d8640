import json

import cv2
import numpy as np
import pytest
import torch

from neural_strands.editing.edit_list import read_edits
from neural_strands.editing.settings import Haircut
from neural_strands.foundation.errors import InputError
from neural_strands.grooms.io import read_groom
from neural_strands.grooms.scenes.scene import SUFFIXES
from neural_strands.runs.newest_model import newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.open_scene import open_run
from neural_strands.viewer.panels import save
from neural_strands.viewer.scene import Scene

CUT = Haircut(length=0.03, uneven=0.0)


@pytest.fixture(scope="module")
def scene(tiny_run):
    """A run whose hair has been cut."""
    return open_run(tiny_run, newest_state(RunFolder(tiny_run)), torch.device("cpu")).with_edits((CUT,))


@pytest.mark.parametrize("suffix", [".usd", ".npz", ".hair", ".glb"])
def test_saved_hair_is_the_edited_hair(scene, tmp_path, suffix):
    name, content = save.saved_hair(scene, suffix)
    assert name == f"run{suffix}"
    (tmp_path / name).write_bytes(content)
    if suffix != ".glb":
        groom = read_groom(tmp_path / name)
        assert len(groom) == 200
        assert float(groom.lengths().max()) < 0.0305


def test_every_format_has_a_name():
    assert set(save.FORMATS) == set(SUFFIXES)
    assert len(set(save.FORMATS.values())) == len(save.FORMATS)


def test_saved_edits_are_the_list_that_the_command_reads(scene, tmp_path):
    name, content = save.saved_edits(scene)
    (tmp_path / name).write_bytes(content)
    assert read_edits(tmp_path / name) == [CUT]
    assert json.loads(content)["edits"][0]["edit"] == "haircut"


def test_a_turntable_is_a_video_and_says_how_far_it_is(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(save, "SECONDS", 1.0)
    monkeypatch.setattr(save, "FPS", 4.0)
    monkeypatch.setattr(save, "SIDE", 64)
    said = []
    name, content = save.saved_turntable(scene, said.append)
    assert said == ["1 of 4", "2 of 4", "3 of 4", "4 of 4"]
    (tmp_path / name).write_bytes(content)
    video = cv2.VideoCapture(str(tmp_path / name))
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1])
    video.release()
    assert [frame.shape for frame in frames] == [(64, 64, 3)] * 4
    assert np.abs(frames[0].astype(int) - frames[2]).mean() > 1


def test_what_is_not_there_cannot_be_saved(scene, tmp_path):
    bare = Scene(tmp_path, "capture")
    with pytest.raises(InputError, match="found none"):
        save.saved_hair(bare, ".usd")
    with pytest.raises(InputError, match="found none"):
        save.saved_turntable(bare, print)
