"""The forecast cost of a fit, and the steps that fit into given minutes."""

from dataclasses import replace

import pytest
import torch

from neural_strands.fitting.config import FitConfig, preset
from neural_strands.fitting.schedule import appearance_begins
from neural_strands.flow.field import FlowConfig
from neural_strands.flow.hair_flow import VOXEL_BYTES, flow_memory
from neural_strands.runs.forecast import USUAL_REACH, Forecast, near_roots, steps_for
from neural_strands.scalp.mannequin import mannequin


def cost(shape_seconds: float, image_seconds: float) -> Forecast:
    return Forecast(120.0, 30.0, shape_seconds, image_seconds, 20.0, 600.0, 2_000_000_000)


def test_stereo_of_unknown_time_is_not_counted() -> None:
    told = Forecast(None, 30.0, 0.25, 0.5, 20.0, 600.0, 2_000_000_000).sentence()
    assert told.startswith("expect stereo, whose time is unknown, and about 10.5 minutes: 0.5 for first strands")


def test_memory_of_tracing_follows_the_room_that_hair_takes() -> None:
    config = FlowConfig(spacing=0.01, margin=0.05)
    box = torch.tensor([[0.0, 0.0, 0.0], [0.2, 0.3, 0.1]])
    small, large = flow_memory(box, config), flow_memory(2 * box, config)
    # Boxes of 0.3 x 0.4 x 0.2 m and 0.5 x 0.7 x 0.3 m, in voxels of 1 cm.
    assert large / small == pytest.approx((50 * 70 * 30) / (30 * 40 * 20), rel=0.1)
    assert small / (30 * 40 * 20) == pytest.approx(VOXEL_BYTES, rel=0.15)


def test_a_head_with_a_whole_body_takes_no_more_memory() -> None:
    head = mannequin()
    roots = head.scalp_mesh.corners().reshape(-1, 3)
    feet = torch.tensor([[0.5, -1.6, 0.0], [-0.5, -1.6, 0.0], [0.0, -1.6, 0.3]])
    mesh = replace(
        head.mesh,
        vertices=torch.cat([head.mesh.vertices, feet]),
        faces=torch.cat([head.mesh.faces, len(head.mesh.vertices) + torch.tensor([[0, 1, 2]])]),
    )
    body = replace(head, mesh=mesh)
    assert torch.equal(near_roots(body, roots), near_roots(head, roots))
    low, high = near_roots(head, roots).aminmax(dim=0)
    # From the crown to beneath the shoulders, and no wider than those.
    assert high[1] == head.mesh.vertices[:, 1].max()
    assert (high - low < 2 * USUAL_REACH).all()
    assert low[1] < roots[:, 1].min() - 0.05


def test_sentence_tells_the_sum_and_its_parts() -> None:
    told = cost(0.25, 0.5).sentence()
    assert "12.5 minutes: 2.0 for stereo, 0.5 for first strands (more if they curl), 10.0 for the steps" in told
    assert "0.25 s without and 0.50 s with an image" in told
    assert "2.0 GB" in told


@pytest.mark.parametrize("minutes", [3.0, 20.0, 60.0])
def test_steps_for_takes_the_minutes_given(minutes: float) -> None:
    config = FitConfig(steps=1000)
    steps = steps_for(minutes, cost(0.2, 0.8), config)
    plain = appearance_begins(steps, config.schedule)
    assert plain * 0.2 + 20.0 + (steps - plain) * 0.8 == pytest.approx(60 * minutes, abs=1.5)


def test_steps_for_leaves_a_result_when_time_is_short() -> None:
    assert steps_for(0.001, cost(10.0, 10.0), preset("demo")) == 10
