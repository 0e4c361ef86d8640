import shutil

import numpy as np
import pytest
import torch

from neural_strands.editing.settings import Haircut, Restyle, Wind
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.runs.newest_model import newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.open_scene import kind_of, open_capture, open_groom, open_model, open_run

CPU = torch.device("cpu")


def test_a_run_has_everything(tiny_run):
    assert kind_of(tiny_run) == "run"
    scene = open_run(tiny_run, newest_state(RunFolder(tiny_run)), CPU)
    assert scene.strands is not None
    assert len(scene.strands) == len(scene.renderer.strands) == 200
    assert scene.strands.color is not None
    assert scene.photographs is not None
    assert len(scene.photographs) == 6
    assert scene.head is not None
    assert scene.segments is not None
    assert len(scene.segments) > 0
    assert scene.note == ""


def test_a_run_whose_photographs_are_gone_shows_its_hair_and_says_so(tiny_run, tmp_path):
    shutil.copytree(tiny_run, tmp_path / "elsewhere" / "run")
    text = (tiny_run / "run.json").read_text().replace(str(tiny_run.parent), str(tmp_path / "gone"))
    run = tmp_path / "elsewhere" / "run"
    (run / "run.json").write_text(text)
    scene = open_run(run, newest_state(RunFolder(run)), CPU)
    assert scene.photographs is None
    assert scene.renderer is not None
    assert "photographs are no longer in" in scene.note


def test_a_run_without_a_state_shows_its_capture(tiny_run):
    scene = open_run(tiny_run, None, CPU)
    assert scene.strands is None
    assert scene.renderer is None
    assert scene.photographs is not None
    assert "as soon as" in scene.note


def test_a_model_alone(tiny_run):
    assert kind_of(tiny_run / "model") == "model"
    scene = open_model(tiny_run / "model", CPU)
    assert scene.strands is not None
    assert len(scene.strands) == 200
    assert scene.photographs is None


def test_a_capture_shows_its_true_strands(tiny_run):
    capture = tiny_run.parent / "ball"
    assert kind_of(capture) == "capture"
    scene = open_capture(capture)
    assert scene.strands is not None
    assert len(scene.strands) == 400
    assert scene.renderer is None
    assert scene.photographs is not None
    assert len(scene.photographs) == 6


@pytest.mark.parametrize("name", ["transforms.json", "sparse/0/cameras.bin", "cameras.txt"])
def test_a_folder_with_cameras_is_a_capture(tmp_path, name):
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).touch()
    assert kind_of(tmp_path) == "capture"


@pytest.mark.parametrize(("unit", "scale"), [(1.0, 1.0), (100.0, 0.01), (1000.0, 0.001)])
def test_a_groom_is_shown_in_metres(tmp_path, unit, scale):
    points = torch.rand(50, 8, 3, generator=torch.Generator().manual_seed(0)) * 0.2
    write_groom(tmp_path / "hair.npz", Groom.from_strands(Strands(points * unit)))
    scene = open_groom(tmp_path / "hair.npz")
    torch.testing.assert_close(scene.strands.points, points, rtol=1e-5, atol=1e-6)
    assert (f"{scale:g} times" in scene.note) == (unit > 1)


def test_what_cannot_be_shown_is_one_sentence(tmp_path):
    with pytest.raises(InputError, match="found nothing"):
        kind_of(tmp_path / "none")
    (tmp_path / "notes.txt").write_text("hair")
    with pytest.raises(InputError, match="expected a groom"):
        kind_of(tmp_path / "notes.txt")
    with pytest.raises(InputError, match=r"expected the folder of a run, .* found another; name one"):
        kind_of(tmp_path)
    with pytest.raises(InputError, match="expected transforms"):
        open_capture(tmp_path)
    np.savez(tmp_path / "bad.npz", a=np.zeros(3))
    with pytest.raises(InputError):
        open_groom(tmp_path / "bad.npz")


def test_edits_made_one_by_one_are_the_same_as_all_at_once(tiny_run):
    scene = open_run(tiny_run, newest_state(RunFolder(tiny_run)), CPU)
    edits = (Haircut(length=0.05), Restyle(volume=0.5), Haircut(fraction=0.2), Wind())
    stepwise = scene
    for count in range(1, len(edits) + 1):
        stepwise = stepwise.with_edits(edits[:count])
    at_once = scene.with_edits(edits)
    assert torch.equal(stepwise.strands.points, at_once.strands.points)
    assert stepwise.with_edits(()).hair is scene.fitted
