"""The built-in template has the proportions of a mean adult's head, which are published, and the mannequin's face."""

import math

import torch

from neural_strands.preparation.face.topology import INTERIOR, NAMED
from neural_strands.preparation.head.builtin import builtin_template, with_mean_skull
from neural_strands.preparation.head.template import bust
from neural_strands.scalp.mannequin import mannequin

LENGTH, BREADTH = 197, 154
"""Mean head length (brow ridge to back of the head) and breadth (above the ears) of men, mm; women's have nearly the
same ratio."""


def profile_depth(vertices: torch.Tensor, height: float) -> float:
    """Largest z of the middle of the head at a height, metres."""
    near = (vertices[:, 0].abs() < 0.008) & ((vertices[:, 1] - height).abs() < 0.004)
    return float(vertices[near, 2].max())


def test_the_skull_is_as_long_as_a_mean_adults():
    vertices = builtin_template().head.mesh.vertices
    brow = builtin_template().landmarks[[NAMED["right_brow_inner"], NAMED["left_brow_inner"]], 1].mean()
    above = vertices[vertices[:, 1] > 0.035]
    breadth = float(above[:, 0].max() - above[:, 0].min())
    length = profile_depth(vertices, float(brow)) - float(vertices[vertices[:, 1] > 0.0, 2].min())
    assert abs(length / breadth - LENGTH / BREADTH) < 0.03


def test_the_forehead_recedes_by_about_ten_degrees():
    vertices = builtin_template().head.mesh.vertices
    back = profile_depth(vertices, 0.02) - profile_depth(vertices, 0.08)
    assert 5 < math.degrees(math.atan2(back, 0.06)) < 15


def test_the_face_stays_the_mannequins():
    points = bust(mannequin()).mesh.vertices
    face = (points[:, 1] < 0.03) & (points[:, 2] > 0)
    torch.testing.assert_close(with_mean_skull(points)[face], points[face])


def test_landmarks_lie_on_the_template():
    from neural_strands.geometry.mesh_queries import closest_points

    template = builtin_template()
    marks = template.landmarks[list(INTERIOR)]
    marks = marks[torch.isfinite(marks).all(dim=1)]
    assert closest_points(marks, template.head.mesh).distance.max() < 1e-3
