"""Restyling of a texture, measured on the strands that come out."""

import math
from dataclasses import replace

import pytest
import torch
from tiny_hair import tiny_hair_model

from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.mix import between as in_between
from neural_strands.editing.mix import blend, transfer
from neural_strands.editing.restyle import restyle
from neural_strands.editing.sample import sample_style
from neural_strands.editing.settings import Blend, Restyle, Sample, Transfer
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import lengths
from neural_strands.model.files import save_hair_model
from neural_strands.prior.traversal import MEASURES, measure
from neural_strands.prior.vae import load_prior


@pytest.fixture(scope="module")
def model():
    """Straight strands of 20 cm that lean by 60 degrees."""
    model = tiny_hair_model(points=100)
    line = torch.linspace(0, 0.2, 100)[None, :, None] * torch.tensor([0.866, 0.0, 0.5])
    with torch.no_grad():
        model.textures.shape[:] = load_prior().without_modulator().encode(line)[0]
    return model


def strands(model, edit):
    return restyle(edit, ScalpShape.of(model), model).decode(model).points


def test_nothing_asked_nothing_changed(model):
    before = ScalpShape.of(model).decode(model).points
    assert torch.allclose(strands(model, Restyle()), before, atol=1e-4)


def test_length(model):
    assert torch.allclose(lengths(strands(model, Restyle(length=1.4))), torch.tensor(0.28), rtol=0.02)


@pytest.mark.parametrize("style", [Restyle(curl=1.0), Restyle(wave=1.0)])
def test_curls_and_waves_are_curlier_and_about_as_long(model, style):
    curliness = MEASURES.index("curliness")
    before = measure(ScalpShape.of(model).decode(model).points)[:, curliness]
    curled = strands(model, style)
    assert (measure(curled)[:, curliness] - before).median() > 1.0
    assert torch.allclose(lengths(curled).median(), torch.tensor(0.2), rtol=0.2)
    straightened = restyle(Restyle(curl=-1.0), restyle(style, ScalpShape.of(model), model), model).decode(model).points
    assert (measure(straightened)[:, curliness] < measure(curled)[:, curliness]).all()


def test_volume_raises_strands_by_its_angle(model):
    def rise(points):
        ends = torch.nn.functional.normalize(points[:, -1] - points[:, 0], dim=1)
        return torch.rad2deg(torch.acos((ends * model.root_frame[:, :, 2]).sum(dim=1).clamp(-1, 1)))

    before = rise(ScalpShape.of(model).decode(model).points)
    assert torch.allclose(before - rise(strands(model, Restyle(volume=1.0))), torch.full((200,), 20.0), atol=1.0)
    assert torch.allclose(rise(strands(model, Restyle(volume=-1.0))) - before, torch.full((200,), 20.0), atol=1.0)


def test_a_painted_region_alone_changes(model):
    changed = strands(model, Restyle(length=2.0, region=((0.2, 0.5, 0.15),)))
    away = (model.root_uv - torch.tensor([0.2, 0.5])).norm(dim=1)
    # Texels are a sixteenth wide, and roots blend four of them.
    assert torch.allclose(lengths(changed[away > 0.25]), torch.tensor(0.2), rtol=0.01)
    assert lengths(changed[away < 0.04]).min() > 0.25
    with pytest.raises(InputError, match="expected a painted region with strands"):
        strands(model, Restyle(length=2.0, region=((5.0, 5.0, 0.1),)))


def test_curl_and_wave_exclude_each_other():
    with pytest.raises(InputError, match="expected curl or wave above 0, found both"):
        Restyle(curl=0.5, wave=0.5)


def test_blend_and_transfer(model, tmp_path):
    other = tiny_hair_model(points=100, seed=1)
    save_hair_model(other, tmp_path / "run" / "model")
    shape, path = ScalpShape.of(model), str(tmp_path / "run")
    # Where both hairstyles are the same strand, every share is that strand.
    same = replace(shape, texture=other.textures.shape.detach())
    half = blend(Blend(path, 0.5), same, model).decode(model).points
    assert torch.allclose(half, same.decode(model).points, atol=1e-4)
    assert torch.allclose(blend(Blend(path, 1.0), shape, model).texture, other.textures.shape, atol=1e-5)
    assert torch.allclose(transfer(Transfer(path), shape, model).texture, other.textures.shape, atol=1e-5)
    assert torch.equal(blend(Blend(path, 0.0), shape, model).texture, shape.texture)
    with torch.no_grad():
        other.generator.linear.bias.add_(0.1)
    save_hair_model(other, tmp_path / "other" / "model")
    with pytest.raises(InputError, match="expected a run with the same strand prior, found another"):
        transfer(Transfer(str(tmp_path / "other")), shape, model)
    with pytest.raises(InputError, match="absent: expected another run or its model, found nothing there"):
        transfer(Transfer(str(tmp_path / "absent")), shape, model)
    # A run whose fit has not ended.
    (tmp_path / "begun").mkdir()
    with pytest.raises(InputError, match=r"expected a hair model's folder .* once the fit has ended"):
        transfer(Transfer(str(tmp_path / "begun")), shape, model)


@pytest.mark.parametrize(
    ("heading", "share", "expected"), [(180, 0.5, (90, -90)), (90, 0.5, (45,)), (-120, 0.25, (-30,))]
)
def test_strands_in_between_turn_about_the_normal_and_lean_as_before(model, heading, share, expected):
    """Two strands of 20 cm that lean by 60 degrees, one along the tangent: neither stands up, and none is shorter."""
    line = torch.linspace(0, 0.2, 100)[:, None]
    angle = torch.tensor(math.radians(heading))
    ways = torch.tensor([[0.866, 0.0, 0.5], [0.866 * float(angle.cos()), 0.866 * float(angle.sin()), 0.5]])
    ours, theirs = load_prior().without_modulator().encode(line * ways[:, None]).split(1)
    between = in_between(model.generator, ours, theirs, torch.tensor([share]))
    tip = model.generator(between, 50)[0, -1]
    assert float(tip.norm()) == pytest.approx(0.2, abs=0.005)
    assert float(tip[2]) == pytest.approx(0.1, abs=0.01)
    found = math.degrees(math.atan2(float(tip[1]), float(tip[0])))
    assert min(abs(found - each) for each in expected) < 4


def test_samples_are_seeded_and_vary_as_told(model):
    shape = ScalpShape.of(model)
    first, second, other = (sample_style(Sample(seed=seed), shape, model).texture for seed in (0, 0, 1))
    assert torch.equal(first, second)
    assert not torch.equal(first, other)
    same = sample_style(Sample(likeness=1.0), shape, model).decode(model).points
    assert torch.allclose(same, shape.decode(model).points, atol=1e-4)
    even = sample_style(Sample(likeness=0.0, variety=0.0), shape, model).decode(model).points
    assert torch.allclose(lengths(even), lengths(even).mean(), rtol=1e-3)
    varied = sample_style(Sample(likeness=0.0, variety=1.0), shape, model).decode(model).points
    assert lengths(varied).std() > 1e-3


def test_a_sampled_strand_turns_with_the_heading_of_the_hair(model):
    """Where the hair heads 90 degrees further round, so does the sample: elsewhere it would stick out sideways."""
    shape = ScalpShape.of(model)
    line = torch.linspace(0, 0.2, 100)[None, :, None] * torch.tensor([0.0, 0.866, 0.5])
    texture = shape.texture.clone()
    half = len(texture) // 2
    texture[half:] = load_prior().without_modulator().encode(line)[0]
    sampled = sample_style(Sample(likeness=0.0, variety=0.0, seed=2), replace(shape, texture=texture), model).texture
    ahead, aside = (model.generator(sampled[row, :1], 50)[0] for row in (0, half))
    x, y, z = ahead.unbind(dim=1)
    torch.testing.assert_close(aside, torch.stack([-y, x, z], dim=1), atol=2e-3, rtol=0)
    assert float(ahead[-1].norm()) > 0.01
