"""What views see of strands, about a ball of known radius."""

import pytest
import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_model import first_model
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.seen_points import seen_points
from neural_strands.prior.vae import load_prior


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture") / "ball"
    strands = write_capture(folder)
    capture, config = Capture.load(folder), tiny_config(hold_out_every=0)
    data = gather_fit_data(capture, find_head(capture, None), true_segments(strands), config, torch.device("cpu"))
    return first_model(data, load_prior(), config), data.views.cameras


def test_what_lies_in_front_is_seen_and_what_it_hides_is_not(scene):
    model, cameras = scene
    camera, radius = cameras[0], float(model.body.vertices.norm(dim=-1).max())
    across, up, ahead = camera.rotation  # rows: the camera's axes in the world, y down
    steps = torch.linspace(-0.2, 0.2, 9)[:, None]
    line = -ahead * (radius + 0.03) + radius * steps * up
    apart = 0.5 * camera.footprint(float((camera.position - line[0]).norm()))
    curtain = torch.stack([line + apart * place * across for place in range(-5, 6)])
    behind_the_curtain = camera.position + (0.8 * line - camera.position) * 1.02
    behind_the_ball = ahead * (radius + 0.03) + radius * steps * up
    past_its_edge = ahead * 0.5 * radius + radius * torch.linspace(0.0, 1.6, 9)[:, None] * across
    others = torch.stack([behind_the_curtain, behind_the_ball, past_its_edge])
    seen = seen_points(model, torch.cat([others, curtain]), [camera])
    assert not seen[:2].any()
    assert not seen[2, :4].any()
    assert seen[2, 6:].all()
    assert seen[3:].any(dim=0).all()


def test_every_view_adds_what_it_sees(scene):
    model, cameras = scene
    strands = model.decode().points
    alone = torch.stack([seen_points(model, strands, [camera]) for camera in cameras])
    together = seen_points(model, strands, cameras)
    assert torch.equal(together, alone.any(dim=0))
    assert (together.sum() > alone.sum(dim=(1, 2))).all()
