"""Hair that no strand reaches: by hand, and over a tiny fit, which must not learn from it."""

from dataclasses import replace

import torch
from tiny_capture import tiny_config, true_segments, write_capture

from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.fitting.first_model import begin
from neural_strands.fitting.fit import fit, networks
from neural_strands.fitting.fit_data import gather_fit_data
from neural_strands.fitting.photographs.surround_weights import BESIDE
from neural_strands.fitting.photographs.unreached import COVERED, unreached_hair
from neural_strands.fitting.schedule import ScheduleConfig
from neural_strands.geometry.views import Views
from neural_strands.model.compositing import REACH
from neural_strands.prior.vae import load_prior


def test_only_hair_far_from_all_strands_is_unreached():
    coverage, reference = torch.zeros(50, 40), torch.zeros(50, 40)
    coverage[20, 5], coverage[12, 25] = 2 * COVERED, 0.5 * COVERED
    reference[10:30, :30], reference[40:, :] = 1.0, BESIDE
    expected = torch.zeros(50, 40, dtype=torch.bool)
    expected[10:30, :30] = True
    expected[20 - REACH : 20 + REACH + 1, : 5 + REACH + 1] = False
    assert torch.equal(unreached_hair(reference, coverage), expected)


def test_the_networks_learn_nothing_from_unreached_hair(tmp_path):
    """Photographs that differ in hair far from all strands lead to the same networks, bit for bit."""
    strands = write_capture(tmp_path / "ball")
    capture = Capture.load(tmp_path / "ball")
    head = find_head(capture)
    config = tiny_config(steps=6, shape_every=0, margin=0, schedule=ScheduleConfig(geometry_only=0.0))
    learned = []
    for colour in (0.0, 0.9):
        data = gather_fit_data(capture, head, true_segments(strands), config, torch.device("cpu"))
        views = []
        for view in data.views:
            image, mask = view.image.clone(), view.hair_mask.clone()
            assert not mask[48:].any()
            image[-5:], mask[-5:] = colour, 1.0
            views.append(replace(view, image=image, hair_mask=mask))
        state = begin(data, load_prior(), config)
        fit(state, replace(data, views=Views.in_memory(views)), config)
        learned.append([weights.detach() for weights in networks(state.model)])
    for one, other in zip(*learned, strict=True):
        assert torch.equal(one, other)
