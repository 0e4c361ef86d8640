"""Leans that are tried for helices."""

import math

import pytest
import torch

from neural_strands.fitting.curls.helices import Leaning
from neural_strands.flow.curls import Lean
from neural_strands.flow.field import FlowField
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.voxel_grid import VoxelGrid


def leaning(degrees: float, agreement: float = 0.4) -> Leaning:
    point = torch.zeros(1, 3)
    nothing = LineSegments(point, point, torch.ones(1), torch.zeros(1, dtype=torch.long))
    grid = VoxelGrid((0.0, 0.0, 0.0), 0.01, (2, 2, 2))
    course = FlowField(grid, torch.zeros(*grid.shape, 3), torch.ones(grid.shape, dtype=torch.bool))
    return Leaning(nothing, course, Lean(math.radians(degrees), agreement), strong=False)


@pytest.mark.parametrize(
    ("measured", "tried"),
    [(20, [20, 35, 50]), (-40, [-40, -55]), (50, [50])],
)
def test_leans_further_than_measured_are_tried_up_to_a_limit(measured, tried):
    assert [math.degrees(lean) for lean in leaning(measured).tried(0.5)] == pytest.approx(tried)


def test_leans_of_segments_that_agree_are_taken_as_measured():
    assert [math.degrees(lean) for lean in leaning(-75, agreement=0.6).tried(0.5)] == pytest.approx([-75])


def test_segments_that_lean_clockwise_are_those_of_right_handed_helices():
    assert leaning(-30).turn == 1
    assert leaning(30).turn == -1
