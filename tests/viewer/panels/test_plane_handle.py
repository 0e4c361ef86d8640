import math

import pytest
import torch

from neural_strands.viewer.panels.plane_handle import middle_of, plane_of


def test_a_level_plane_cuts_what_is_below():
    assert plane_of((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0)) == pytest.approx((0.1, 0.2, 0.3, 0.0, -1.0, 0.0))


def test_the_normal_turns_with_the_sheet():
    # A quarter turn about z takes -y to +x.
    quarter = math.sqrt(0.5)
    assert plane_of((0.0, 0.0, 0.0), (quarter, 0.0, 0.0, quarter))[3:] == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)


def test_the_plane_starts_in_the_lower_half_of_the_hair():
    points = torch.rand(20, 5, 3, generator=torch.Generator().manual_seed(0))
    points[3, 2] = float("nan")
    x, y, z = middle_of(points)
    assert x == pytest.approx(0.5, abs=0.05)
    assert y == pytest.approx(0.25, abs=0.05)
    assert z == pytest.approx(0.5, abs=0.05)
