"""Schedules at their ends and between."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.special
import torch

from neural_strands.fitting.config import preset
from neural_strands.fitting.schedule import (
    ScheduleConfig,
    appearance_begins,
    appearance_blur_width,
    blur_width,
    improves,
    rate_factor,
    released_points,
    settles,
)
from neural_strands.raster.texture import sample_texture


def test_blur_falls_from_the_widest_to_one_texel_and_then_to_none():
    config = ScheduleConfig(widest_blur=16.0, blur_until=0.5)
    widths = [blur_width(step, 1000, config) for step in range(1000)]
    assert widths[0] == 16.0
    assert widths[250] == 4.0
    assert all(a >= b for a, b in pairwise(widths))
    assert 1.0 < widths[499] < 1.01
    assert widths[500:] == [0.0] * 500
    assert blur_width(3, 1000, ScheduleConfig(widest_blur=0.0)) == 0.0


def test_the_blur_of_appearance_falls_from_where_images_begin():
    config = ScheduleConfig(appearance_blur=4.0, geometry_only=0.1, appearance_blur_until=0.9)
    widths = [appearance_blur_width(step, 1000, config) for step in range(100, 1000)]
    assert widths[0] == 4.0
    assert widths[400] == 2.0
    assert all(a >= b for a, b in pairwise(widths))
    assert 1.0 < widths[799] < 1.01
    assert widths[800:] == [0.0] * 100
    assert appearance_blur_width(500, 1000, ScheduleConfig(appearance_blur=0.0)) == 0.0


@pytest.mark.parametrize("name", ["demo", "fast", "paper"])
@pytest.mark.parametrize("fraction", [0.1, 0.2, 0.3, 0.475, 0.5, 0.9])
def test_a_strand_learns_on_its_own_once_the_blur_of_appearance_has_ended(name, fraction):
    """The gradient of one texel: taps of the discrete Gaussian, 3 texels wide at a tenth of the steps and 1 at half."""
    config = preset(name).schedule
    texture = torch.zeros(65, 65, 1, dtype=torch.float64, requires_grad=True)
    middle = torch.tensor([[0.5, 0.5]], dtype=torch.float64)
    blur = appearance_blur_width(round(fraction * 10_000), 10_000, config)
    sample_texture(texture, middle, blur).sum().backward()
    assert texture.grad is not None
    variance = 9 ** ((0.5 - fraction) / 0.4) if fraction < 0.5 else 0.0
    taps = scipy.special.ive(abs(np.arange(-32, 33)), variance)
    np.testing.assert_allclose(texture.grad[..., 0], np.outer(taps, taps), atol=1e-7)


def test_strands_settle_at_their_share_of_the_steps_and_not_before_images_count():
    assert settles(1000, ScheduleConfig(settled_from=0.5)) == 500
    assert settles(1000, ScheduleConfig()) == 1000
    assert settles(1000, ScheduleConfig(geometry_only=0.3, settled_from=0.1)) == 300


def test_colours_are_improved_between_settling_and_the_end():
    assert improves(1000, ScheduleConfig(settled_from=0.5)) == 800
    assert improves(1000, ScheduleConfig(settled_from=0.5, improved_from=0.7001)) == 701
    assert improves(1000, ScheduleConfig(settled_from=0.8)) is None
    assert improves(1000, ScheduleConfig(settled_from=0.5, improved_from=1.0)) is None
    assert improves(1000, ScheduleConfig()) is None


def test_strands_are_released_from_root_to_tip():
    config = ScheduleConfig(release_until=0.4)
    counts = [released_points(step, 1000, 100, config) for step in range(1000)]
    assert counts[0] == 2
    assert counts[200] == 2 + 49
    assert all(a <= b for a, b in pairwise(counts))
    assert counts[399] < 100
    assert counts[400] == 100
    assert released_points(0, 1000, 100, ScheduleConfig(release_until=0.0)) == 100


def test_images_begin_when_geometry_is_done():
    assert appearance_begins(1000, ScheduleConfig(geometry_only=0.3)) == 300
    assert appearance_begins(10, ScheduleConfig(geometry_only=0.0)) == 0


def test_rates_rise_and_fall():
    config = ScheduleConfig(warmup=10, final_rate=0.1)
    factors = [rate_factor(step, 1000, config) for step in range(1001)]
    assert abs(factors[0] - 0.1) < 1e-3
    assert max(factors) == factors[9]
    assert all(a > b for a, b in pairwise(factors[10:]))
    assert abs(factors[1000] - 0.1) < 1e-9
