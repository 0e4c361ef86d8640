"""Lists of edits: their JSON, their order, and what is refused."""

import json

import pytest
import torch
from tiny_hair import tiny_hair_model

from neural_strands.editing.edit_list import apply_edits, fitted_per_strand, read_edits, write_edits
from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import Density, Haircut
from neural_strands.foundation.configs import check_config
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import lengths

EDITS = [Haircut(plane=(0.0, 1.0, 0.0, 0.0, 1.0, 0.0), region=((0.1, 0.2, 0.3),), seed=4), Density(50)]


def test_written_lists_are_read_back(tmp_path):
    write_edits(tmp_path / "edits.json", EDITS)
    assert read_edits(tmp_path / "edits.json") == EDITS


def test_density_after_a_cut_is_denser_hair_cut():
    hair = Hair.of(tiny_hair_model())
    edits = [Haircut(length=0.03, uneven=0.0), Density(400)]
    one, other = apply_edits(hair, edits), apply_edits(hair, edits[::-1])
    assert torch.equal(one.strands.points, other.strands.points)
    assert len(one.strands) == 400
    assert (lengths(one.strands.points) < 0.0301).all()


def test_edits_of_textures_need_a_model():
    hair = Hair(Hair.of(tiny_hair_model()).strands)
    assert len(apply_edits(hair, [Haircut(length=0.03)]).strands) == 200
    with pytest.raises(InputError, match=r"density: expected a fitted run .* found a groom alone; name the run"):
        apply_edits(hair, [Density(10)])


@pytest.mark.parametrize(
    ("edits", "message"),
    [
        ([{"edit": "comb"}], r"edits\[0\].edit: expected one of haircut, density, restyle"),
        ([{"length": 0.1}], "expected a value under 'edit'"),
        ([{"edit": "haircut", "length": -1}], r"edits\[0\].length: expected a finite number from 0.001 to 10.0"),
        ([{"edit": "haircut", "lenght": 1}], r"edits\[0\].lenght: expected a setting that Haircut has"),
        ([{"edit": "haircut"}], "haircut: expected one of length, fraction"),
        ([{"edit": "density"}], "expected settings that Density takes"),
        ({}, "edits: expected a list"),
    ],
)
def test_refusals(tmp_path, edits, message):
    path = tmp_path / "edits.json"
    path.write_text(json.dumps({"format": 1, "edits": edits}))
    with pytest.raises(InputError, match=message):
        read_edits(path)


def test_bounds_hold_for_edits_from_the_command_line_too():
    check_config(EDITS[0], "haircut")
    with pytest.raises(InputError, match=r"haircut: fraction: expected a finite number from 0.0 to 1.0, found 3.0"):
        check_config(Haircut(fraction=3.0), "haircut")


def test_the_last_density_determines_how_many_fitted_strands_each_stands_for():
    fitted = Hair.of(tiny_hair_model()).strands
    assert fitted_per_strand(fitted, [Haircut(length=0.03)]) == 1.0
    assert fitted_per_strand(fitted, [Density(50), Haircut(length=0.03), Density(400)]) == 0.5
