"""Texels that no photograph shows take the appearance of their neighbours; the others keep their own."""

import math

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_model import first_model
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.unseen_appearance import ENOUGH, fill_unseen_appearance, texel_weights
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


def test_weights_count_the_line_pixels_of_all_photographs(scene):
    data, model = scene
    strands = model.decode()
    weights = texel_weights(model, strands, data.views)
    lines = [model.draw(strands, camera).lines for camera in data.views.cameras]
    seen = sum(float((buffer.segment >= 0).sum()) for buffer in lines)
    assert float(weights.sum()) == pytest.approx(seen, rel=1e-4)
    visible = visible_points(lines[0], strands.points, model.config.supersample)
    assert weights.shape == (32, 32, model.textures.knots)
    assert len(visible) > 100


def test_hair_at_the_back_takes_the_colours_of_the_hair_in_front(scene):
    data, model = scene
    strands = model.decode()
    seen = texel_weights(model, strands, data.views) >= ENOUGH
    knots = model.textures.knots
    # What was learned, in green; what was not, in a colour far from it.
    values = torch.where(seen[..., None], 1.0 + 0.1 * torch.rand(32, 32, knots, 1), -7.0)
    with torch.no_grad():
        model.textures.appearance.copy_(values.expand(-1, -1, -1, 16).flatten(2))
    assert (read(model) < 0).float().mean() > 0.1
    fill_unseen_appearance(model, strands, data.views)
    after = model.textures.appearance.detach().unflatten(2, (knots, -1))
    assert torch.equal(after[seen], values.expand(-1, -1, -1, 16)[seen])
    assert ((after >= 1.0 - 1e-5) & (after <= 1.1 + 1e-5)).all()
    assert (read(model) > 0).all()


def test_a_fit_remembers_where_its_photographs_were_taken_from(scene):
    data, model = scene
    assert model.seen_from.shape == (len(data.views), 3)
    assert (torch.rad2deg(torch.acos(model.seen_from[:, 2])) < 90).all()
    behind = max(math.degrees(math.atan2(abs(float(x)), float(z))) for x, _, z in model.seen_from)
    assert behind < 90


def read(model: HairModel) -> torch.Tensor:
    """The appearance that the strands read."""
    return model.textures.sample_appearance(model.root_uv).detach()
