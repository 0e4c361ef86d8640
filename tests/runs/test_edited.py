"""Edited folders: their contents, and that they open again after being moved with their source."""

import json
import shutil
from dataclasses import replace

import pytest
import torch
from full_disk import smallest_files
from tiny_hair import tiny_hair_model

from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import Density, Haircut
from neural_strands.foundation.errors import InputError
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import write_groom
from neural_strands.model.files import save_hair_model
from neural_strands.runs.edited import open_hair, save_edited


@pytest.fixture
def run(tmp_path):
    model = tiny_hair_model()
    save_hair_model(model, tmp_path / "here" / "run" / "model")
    strands = replace(Hair.of(model).strands, color=torch.rand(200, 3))
    write_groom(tmp_path / "here" / "run" / "groom.npz", Groom.from_strands(strands))
    return tmp_path / "here" / "run"


def test_edited_hair_opens_again(run, tmp_path):
    edited = open_hair(run).edited([Haircut(length=0.03)])
    save_edited(run.parent / "cut", edited)
    again = open_hair(run.parent / "cut")
    assert torch.equal(again.hair.strands.points, edited.hair.strands.points)
    assert again.hair.strands.t is not None
    assert torch.equal(again.hair.strands.t, edited.hair.strands.parameters())
    assert again.edits == (Haircut(length=0.03),)
    assert again.hair.model is not None
    run.parent.rename(tmp_path / "there")
    moved = open_hair(tmp_path / "there" / "cut")
    assert moved.source == (tmp_path / "there" / "cut" / ".." / "run")
    shutil.rmtree(tmp_path / "there" / "run")
    with pytest.raises(InputError, match=r"expected the hair that was edited at .* found nothing there"):
        open_hair(tmp_path / "there" / "cut")


def test_further_edits_start_from_the_fitted_hair(run):
    save_edited(run.parent / "cut", open_hair(run).edited([Haircut(length=0.03, uneven=0.0)]))
    denser = open_hair(run.parent / "cut").edited([Density(300)])
    assert len(denser.hair.strands) == 300
    assert denser.edits == (Haircut(length=0.03, uneven=0.0), Density(300))
    assert torch.equal(
        denser.hair.strands.points,
        open_hair(run).edited([Density(300), Haircut(length=0.03, uneven=0.0)]).hair.strands.points,
    )


def test_a_run_brings_the_colours_of_its_groom(run):
    cut = open_hair(run).edited([Haircut(length=0.03)])
    assert cut.hair.strands.color is not None


def test_a_groom_alone_can_be_cut(run, tmp_path):
    edited = open_hair(run / "groom.npz").edited([Haircut(length=0.03)])
    save_edited(tmp_path / "cut", edited)
    assert open_hair(tmp_path / "cut").hair.model is None


def test_a_fit_that_has_not_ended_is_one_sentence(run):
    shutil.rmtree(run / "model")
    (run / "run.json").write_text("{}")
    with pytest.raises(InputError, match=r"run: expected a fit that has ended, found one that has not written its mod"):
        open_hair(run)


def test_nothing_else_is_replaced(run, tmp_path):
    edited = open_hair(run).edited([Haircut(length=0.03)])
    with pytest.raises(InputError, match="expected a new folder or one of edited hair"):
        save_edited(run, edited)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="expected a new folder or one of edited hair"):
        save_edited(tmp_path / "file", edited)
    save_edited(tmp_path / "cut", edited)
    save_edited(tmp_path / "cut", edited.edited([Density(50)]))
    assert len(json.loads((tmp_path / "cut" / "edit.json").read_text())["edits"]) == 2


def test_a_folder_that_cannot_be_written_is_one_sentence(run, tmp_path):
    edited = open_hair(run).edited([Haircut(length=0.03)])
    with smallest_files(1000), pytest.raises(InputError, match="cannot be written"):
        save_edited(tmp_path / "cut", edited)
    assert not (tmp_path / "cut").exists()
