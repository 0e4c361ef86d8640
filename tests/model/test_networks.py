"""Weights of networks alone: what is written is read, and what does not fit is refused in one sentence."""

from dataclasses import replace

import pytest
import torch
from safetensors.torch import load_file, save_file

from neural_strands.fitting.config import preset
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh
from neural_strands.model import networks as networks_module
from neural_strands.model.files import WEIGHTS_NAME, save_hair_model
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.hair_volume import CHANNELS
from neural_strands.model.networks import (
    SHIPPED,
    leave_colours,
    read_networks,
    save_networks,
    shipped_networks,
    start_networks,
)
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.scalp.roots import Roots

CONFIG = HairModelConfig(
    ScalpTextureConfig(shape_size=4, appearance_size=4, appearance_channels=4), UNetConfig(widths=(4, 6)), points=8
)


def model_of(config: HairModelConfig, seed: int) -> HairModel:
    roots = Roots(torch.zeros(4, 3), torch.rand(4, 2), torch.eye(3).expand(4, 3, 3).contiguous(), torch.zeros(4))
    triangle = Mesh(torch.eye(3), torch.tensor([[0, 1, 2]]))
    return HairModel(config, roots, StrandGenerator(), triangle, torch.Generator().manual_seed(seed))


@pytest.fixture
def written(tmp_path):
    save_networks(model_of(CONFIG, 1), tmp_path / "networks.safetensors", {"made": "here"})
    return tmp_path / "networks.safetensors"


def test_a_model_starts_from_what_was_written_and_keeps_the_rest(written):
    model, source = model_of(CONFIG, 2), model_of(CONFIG, 1)
    before = {name: value.clone() for name, value in model.state_dict().items() if isinstance(value, torch.Tensor)}
    start_networks(model, read_networks(written, CONFIG))
    for name, value in model.state_dict().items():
        expected = source.state_dict()[name] if name.startswith(("unet.", "shading.")) else before[name]
        assert torch.equal(value, expected), name
    assert not torch.equal(before["unet.output"], model.unet.output)


@torch.no_grad()
def test_networks_can_leave_colours_to_the_textures_and_still_change_opacity():
    model = model_of(CONFIG, 1)
    model.shading.outer.normal_()
    model.unet.bias.fill_(0.3)
    pyramid = [torch.rand(1, CONFIG.descriptor_channels, size, size) for size in (8, 4)]
    opacity = model.unet(pyramid)[:, 3]
    leave_colours(model)
    after = model.unet(pyramid)
    assert not after[:, :3].any()
    assert torch.equal(after[:, 3], opacity)
    appearance, directions = torch.randn(5, 4), torch.nn.functional.normalize(torch.randn(5, 3), dim=1)
    fibre = torch.cat([directions, torch.rand(5, 1)], dim=1)
    shaded = model.shading(appearance, fibre, directions, torch.rand(5, CHANNELS))
    torch.testing.assert_close(shaded, appearance @ model.shading.decode.T + model.shading.mean)


def test_the_file_of_a_whole_model_serves_as_well(written, tmp_path):
    save_hair_model(model_of(CONFIG, 1), tmp_path / "model")
    whole, alone = (read_networks(path, CONFIG) for path in (tmp_path / "model" / WEIGHTS_NAME, written))
    assert whole.keys() == alone.keys()
    assert all(torch.equal(whole[name], alone[name]) for name in whole)


@pytest.mark.parametrize(
    ("config", "found"),
    [
        (replace(CONFIG, unet=UNetConfig(widths=(4, 8))), r"found unet\.\S+ of \("),
        (replace(CONFIG, unet=UNetConfig(widths=(4, 6, 6))), "found none named unet"),
        (replace(CONFIG, unet=UNetConfig(widths=(4,))), r"found another one, unet\.decoders"),
        (replace(CONFIG, textures=replace(CONFIG.textures, appearance_channels=6)), "networks of this fit's sizes"),
    ],
    ids=["wider", "deeper", "flatter", "more features"],
)
def test_other_sizes_are_refused(written, config, found):
    with pytest.raises(InputError, match=found):
        read_networks(written, config)


def test_damaged_files_are_refused(written, tmp_path):
    weights = load_file(written)
    weights["unet.bias"][0] = torch.nan
    save_file(weights, tmp_path / "nan.safetensors")
    (tmp_path / "cut.safetensors").write_bytes(written.read_bytes()[:200])
    for name, found in (("nan", "NaN or infinity in unet.bias"), ("cut", "something else"), ("absent", "no file")):
        with pytest.raises(InputError, match=found):
            read_networks(tmp_path / f"{name}.safetensors", CONFIG)


@pytest.mark.parametrize("name", ["demo", "fast"])
def test_the_presets_have_shipped_networks(name):
    networks = shipped_networks(preset(name).model)
    assert networks is not None
    # A random start has no biases at all.
    assert all(float(value.abs().max()) > 0 for key, value in networks.items() if "bias" in key)


def test_other_networks_have_none_shipped(monkeypatch, written, tmp_path):
    assert shipped_networks(CONFIG) is None
    widths = preset("fast").model.unet.widths
    monkeypatch.setattr(networks_module, "SHIPPED", tmp_path)
    # A file of the right name but with other sizes inside counts as none.
    written.rename(tmp_path / f"networks_{'_'.join(map(str, widths))}.safetensors")
    assert shipped_networks(preset("fast").model) is None


def test_shipped_weights_are_small():
    assert 0 < sum(path.stat().st_size for path in SHIPPED.iterdir()) < 1_000_000
