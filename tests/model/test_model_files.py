"""Folders of hair models: anything else is refused in one sentence, before anything large is built."""

import json
from pathlib import Path

import pytest
import torch
from damage import EDIT, damage, fuzz, merged, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import load_file, save_file

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh
from neural_strands.model.files import load_hair_model, save_hair_model
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.surround.body import SurroundConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.scalp.roots import Roots


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    """A model of four strands on a triangle."""
    config = HairModelConfig(
        ScalpTextureConfig(shape_size=4, appearance_size=4, appearance_channels=2),
        UNetConfig(widths=(4, 4)),
        SurroundConfig(background_texture=4, background_directions=6),
        points=8,
    )
    triangle = Mesh(torch.eye(3), torch.tensor([[0, 1, 2]]))
    roots = Roots(torch.rand(4, 3), torch.rand(4, 2), torch.eye(3).expand(4, 3, 3).contiguous(), torch.zeros(4))
    folder = tmp_path_factory.mktemp("models") / "hair"
    save_hair_model(HairModel(config, roots, StrandGenerator(), triangle, torch.Generator()), folder)
    return folder


def copied(saved: Path, tmp_path: Path) -> Path:
    for path in saved.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


CONFIGS = {
    "nested": ("[" * 100_000, "nested too deeply"),
    "list": ("[]", "expected an object"),
    "no format": ({"format": None}, "a value under 'format'"),
    "other format": ({"format": "9"}, "format: expected 12, found '9'; use the version"),
    "odd latent": ({"generator": {"latent": 1}}, "coupling layers need an even latent, found 1"),
    "layers": ({"generator": {"layers": 2**63}}, r"generator\.layers: expected a whole number from 0 to 64"),
    "warps": ({"generator": {"synthesiser": {"warps": 10**7}}}, r"generator\.synthesiser\.warps: expected a whole"),
    "taps": ({"model": {"unet": {"low_pass": {"taps": 10**9}}}}, r"model\.unet\.low_pass\.taps: expected a whole"),
    "odd taps": ({"model": {"unet": {"low_pass": {"taps": 13}}}}, r"model\.unet\.low_pass: expected settings"),
    "widths": ({"model": {"unet": {"widths": "wide"}}}, r"model\.unet\.widths: expected a list"),
    "width": ({"model": {"unet": {"widths": [10**6]}}}, r"model\.unet\.widths\[0\]: expected a whole number"),
    "texels": ({"model": {"textures": {"shape_size": 8000}}}, r"textures\.shape of shape \(4, 4, 64\) in place of"),
    "sphere": ({"model": {"surround": {"background_texture": 10**6}}}, "background_texture: expected a whole number"),
    "hidden": ({"model": {"shading": {"hidden": 32}}}, "weights that do not fit config.json"),
    "nan": ({"model": {"surround": {"background_distance": float("nan")}}}, "NaN, which is no number"),
    "points": ({"model": {"points": 10**9}}, r"model\.points: expected a whole number"),
    "latent": ({"generator": {"latent": 32}}, "weights that do not fit config.json"),
}


@pytest.mark.parametrize("name", sorted(CONFIGS))
def test_a_wrong_config_is_one_sentence(saved, tmp_path, name):
    changes, message = CONFIGS[name]
    folder = copied(saved, tmp_path)
    described = json.loads((folder / "config.json").read_text())
    content = changes if isinstance(changes, str) else json.dumps(merged(described, changes))
    (folder / "config.json").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        load_hair_model(folder)
    assert str(caught.value).startswith(str(folder))
    assert str(caught.value).isprintable()


TENSORS = {
    "missing": ({"root_uv": None}, r"root_uv of shape none in place of \(4, 2\)"),
    "roots": ({"root_uv": torch.zeros(3, 2)}, r"root_uv of shape \(3, 2\) in place of \(4, 2\)"),
    "axes": ({"root_position": torch.zeros(4)}, "root_position of shape"),
    "nan": ({"root_position": torch.full((4, 3), torch.nan)}, "NaN or infinity in root_position"),
    "faces": ({"body.faces": torch.tensor([[0, 1, 3]])}, "faces beyond the body's 3 vertices"),
    "face type": ({"body.faces": torch.zeros(1, 3)}, "faces beyond the body's 3 vertices"),
    "functions": ({"textures.view": torch.zeros(3, 4, 4, 3)}, r"textures\.view of shape \(3, 4, 4, 3\) in place of"),
    "no axes": ({"textures.view": torch.tensor(0.0)}, "textures.view of shape none in place of"),
    "more": ({"surprise": torch.zeros(3)}, "surprise"),
}


@pytest.mark.parametrize("name", sorted(TENSORS))
def test_wrong_tensors_are_one_sentence(saved, tmp_path, name):
    changes, message = TENSORS[name]
    folder = copied(saved, tmp_path)
    tensors = load_file(folder / "model.safetensors") | changes
    save_file({k: v for k, v in tensors.items() if v is not None}, folder / "model.safetensors")
    with pytest.raises(InputError, match=message):
        load_hair_model(folder)


def test_colours_that_change_with_the_view_are_kept(saved, tmp_path):
    model = load_hair_model(saved)
    assert model.textures.view.shape == (0, 4, 4, 3)
    model.textures.change_with_view()
    model.textures.view.normal_(generator=torch.Generator().manual_seed(0))
    save_hair_model(model, tmp_path / "changing")
    assert torch.equal(load_hair_model(tmp_path / "changing").textures.view, model.textures.view)


@fuzz(60)
@given(edits=st.lists(EDIT, min_size=1, max_size=3))
def test_a_damaged_config(saved: Path, tmp_path: Path, edits: list):
    folder = copied(saved, tmp_path)
    content = damage((saved / "config.json").read_bytes(), edits)

    def load(path: Path) -> None:
        try:
            load_hair_model(path.parent)
        except InputError as error:
            # If weights have other shapes, the folder is at fault.
            raise InputError(str(error).replace(f"{folder}: ", f"{path}: ")) from error

    read_or_refuse(folder / "config.json", content, load, most=40_000_000)
