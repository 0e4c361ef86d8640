"""Texels that photographs hardly show take the appearance of their neighbours, at least elsewhere; others stay."""

import math

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_colours import scatter_to_texture
from neural_strands.fitting.first_model import first_model
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.unseen_appearance import (
    BORDER,
    ENOUGH,
    ENOUGH_UNSEEN,
    fill_unseen_appearance,
    knot_pixels,
    with_detail,
)
from neural_strands.model.hair_model import HairModel
from neural_strands.prior.vae import load_prior
from neural_strands.raster.visible import visible_points

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture") / "ball"
    strands = write_capture(folder)
    capture, config = Capture.load(folder), tiny_config(hold_out_every=0)
    head, segments = find_head(capture, None), true_segments(strands)
    front = [index for index, camera in enumerate(capture.cameras) if camera.position[2] > 0]
    data = gather_fit_data(capture.subset(front), head, segments, config, CPU)
    return data, first_model(data, load_prior(), config)


def test_pixels_of_knots_and_texels_are_the_line_pixels_of_all_photographs(scene):
    data, model = scene
    strands = model.decode()
    pixels = knot_pixels(model, strands, data.views)
    lines = [model.draw(strands, camera).lines for camera in data.views.cameras]
    seen = sum(float((buffer.segment >= 0).sum()) for buffer in lines)
    everywhere, inside = pixels.unbind(dim=2)
    assert float(everywhere.sum()) == pytest.approx(seen, rel=1e-4)
    far = [far_inside(mask) for mask in (data.views.hair_mask(index) for index in range(len(data.views)))]
    deep = sum(float(((b.segment >= 0) & f).sum()) for b, f in zip(lines, far, strict=True))
    assert float(inside.sum()) == pytest.approx(deep, rel=1e-4)
    assert 0 < deep < 0.5 * seen
    weights = texel_sums(model, strands, everywhere)
    assert weights.shape == (32, 32, model.textures.knots)
    assert float(weights.sum()) == pytest.approx(seen, rel=1e-4)
    visible = visible_points(lines[0], strands.points, model.config.supersample)
    assert len(visible) > 100


def far_inside(mask):
    """Pixels whose square of neighbours up to BORDER away has nothing but hair, as far as it lies in the image."""
    rows, columns = mask.shape
    return torch.tensor(
        [
            [
                bool((mask[max(y - BORDER, 0) : y + BORDER + 1, max(x - BORDER, 0) : x + BORDER + 1] > 0.5).all())
                for x in range(columns)
            ]
            for y in range(rows)
        ]
    )


def texel_sums(model, strands, values):
    sums, _ = scatter_to_texture(values, strands.root_uv, 32, 32)
    return sums


def learned(scene):
    """Line pixels of each texel; what was learned has values from 1 to 1.1, and what was not is far from it."""
    data, model = scene
    strands = model.decode()
    pixels = texel_sums(model, strands, knot_pixels(model, strands, data.views)[..., 0])
    shown = (pixels >= ENOUGH)[..., None]
    values = torch.where(shown, 1.0 + 0.1 * torch.rand(*pixels.shape, 1), -7.0).expand(-1, -1, -1, 16)
    model.textures.change_with_view()
    with torch.no_grad():
        model.textures.appearance.copy_(values.flatten(2))
        # In every view function as in the appearance, with other signs for what was learned.
        model.textures.view.copy_(torch.where(shown, -values[..., :3], values[..., :3]).flatten(2))
    return strands, pixels, values


def parts_of(strands, unseen):
    return torch.full((len(strands.points), 6), unseen)


def test_hair_at_the_back_takes_the_colours_of_the_hair_in_front(scene):
    data, model = scene
    strands, pixels, values = learned(scene)
    seen = pixels >= ENOUGH * (1 + 1e-5)
    assert (read(model) < 0).float().mean() > 0.1
    fill_unseen_appearance(model, strands, data.views, parts_of(strands, unseen=False))
    after = texels(model.textures.appearance)
    assert torch.equal(after[seen], values[seen])
    assert not model.textures.elsewhere.any()
    # The colour of neighbours, and the detail of texels elsewhere.
    assert ((after >= 0.9 - 1e-5) & (after <= 1.2 + 1e-5)).all()
    assert (read(model) > 0).all()
    change = model.textures.view.unflatten(3, (-1, 3))
    assert torch.equal(change[:, seen], -values[seen][:, :3].expand(len(change), -1, -1))
    assert ((change <= -1.0 + 1e-5) & (change >= -1.1 - 1e-5)).all()


def test_hair_that_views_only_graze_keeps_little_of_its_own_colours_elsewhere(scene):
    data, model = scene
    strands, pixels, values = learned(scene)
    left = strands.points[:, 0, 0] < 0
    on_the_left, on_the_right = (
        texel_sums(model, strands, side[:, None].expand(-1, model.textures.knots).float()) for side in (left, ~left)
    )
    grazed = (pixels >= ENOUGH) & (pixels < 0.1 * ENOUGH_UNSEEN) & (on_the_left > 0) & (on_the_right == 0)
    faced = (pixels >= ENOUGH) & (on_the_left == 0)
    assert min(int(grazed.sum()), int(faced.sum())) > 50
    with torch.no_grad():
        # What was learned of hair that views graze is odd.
        values = torch.where(grazed[..., None], 3.0, values)
        model.textures.appearance.copy_(values.flatten(2))
    fill_unseen_appearance(model, strands, data.views, left[:, None].expand(-1, 6))
    near = texels(model.textures.appearance)
    shown = pixels >= ENOUGH * (1 + 1e-5)
    assert torch.equal(near[shown], values[shown])
    after = texels(model.textures.appearance + model.textures.elsewhere)
    torch.testing.assert_close(after[faced], values[faced])
    assert after[grazed].max() < 2.9
    assert after[grazed].mean() < 2.3
    # Texels of both sides have neighbours of either.
    edge = torch.nn.functional.max_pool2d(faced.permute(2, 0, 1).float(), 3, stride=1, padding=1).permute(1, 2, 0) > 0
    assert after[grazed & edge].mean() < 1.6


def test_what_is_filled_in_varies_like_what_was_learned(generator):
    """Half of a texture was learned: a ramp and noise, with another sign at the second knot. The rest is the ramp."""
    ramp = torch.linspace(0, 1, 120)[:, None].expand(120, 80)
    noise = 0.05 * torch.randn(120, 80, generator=generator)
    trust = (torch.arange(80) < 40).float().expand(120, -1)
    signs = torch.tensor([1.0, -1.0])
    values = ramp[..., None] + torch.where(trust > 0, noise, 0.0)[..., None] * signs
    found = with_detail(values[..., None], trust[..., None].expand(-1, -1, 2))[..., 0]
    assert torch.equal(found[:, :40], values[:, :40])
    added = (found - values)[:, 40:]
    assert float(added.std()) == pytest.approx(0.05, rel=0.15)
    assert abs(float(added.mean())) < 0.01
    # What belongs together along a strand stays together.
    torch.testing.assert_close(added[..., 0], -added[..., 1], atol=0.02, rtol=0)


def test_knots_take_as_much_detail_as_they_lack_trust(generator):
    values = torch.randn(30, 30, 1, 1, generator=generator)
    trust = torch.ones(30, 30, 1)
    trust[:15] = 0.0
    whole = with_detail(values, trust) - values
    trust[:15] = 0.75
    torch.testing.assert_close(with_detail(values, trust) - values, 0.25 * whole)
    assert torch.equal(with_detail(values, 0.9 * trust), values)
    smooth = torch.full_like(values, 0.4)
    torch.testing.assert_close(with_detail(smooth, trust), smooth)


def test_a_fit_remembers_where_its_photographs_were_taken_from(scene):
    data, model = scene
    assert model.seen_from.shape == (len(data.views), 3)
    assert (torch.rad2deg(torch.acos(model.seen_from[:, 2])) < 90).all()
    behind = max(math.degrees(math.atan2(abs(float(x)), float(z))) for x, _, z in model.seen_from)
    assert behind < 90


def texels(texture: torch.Tensor) -> torch.Tensor:
    """A texture with an axis for the knots of the model."""
    return texture.detach().unflatten(2, (-1, 16))


def read(model: HairModel) -> torch.Tensor:
    """The appearance that the strands read."""
    return model.textures.sample_appearance(model.root_uv).detach()
