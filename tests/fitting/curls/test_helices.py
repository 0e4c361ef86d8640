"""Leans that are tried for helices, and segments that mislead."""

import math

import pytest
import torch

from neural_strands.fitting.curls.helices import Leaning, along_course
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


def test_segments_far_off_the_course_are_left_out():
    """Some angles off a course that points down, any of them about the vertical; those that point up are far off."""
    degrees = torch.tensor([0.0, 20.0, 34.0, 36.0, 90.0, 179.0])
    random = torch.Generator().manual_seed(0)
    angle, turn = torch.deg2rad(degrees), 2 * math.pi * torch.rand(len(degrees), generator=random)
    directions = torch.stack([angle.sin() * turn.cos(), -angle.cos(), angle.sin() * turn.sin()], dim=-1)
    count, grid = len(degrees), VoxelGrid((0.0, 0.0, 0.0), 0.01, (2, 2, 2))
    points = 0.01 * torch.rand(count, 3, generator=random)
    segments = LineSegments(points, directions, torch.ones(count), torch.arange(count))
    down = torch.tensor([0.0, -0.4, 0.0]).expand(*grid.shape, 3)
    course = FlowField(grid, down, torch.ones(grid.shape, dtype=torch.bool))
    assert along_course(segments, course, 35.0).segment_id.tolist() == [0, 1, 2]
    assert len(along_course(segments, course, 180.0).points) == count
