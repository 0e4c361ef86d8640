"""Distances between outlines of balls, which are circles when seen from afar."""

import math

import numpy as np
import pytest
import torch
import trimesh

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.preparation.head.outline import Outline
from neural_strands.raster.triangles import rasterise_triangles

DISTANCE, RADIUS, SIDE = 100.0, 0.10, 400
PIXEL = 0.001
"""Side of a pixel at the ball, metres."""


def ball(radius: float) -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return Mesh(torch.from_numpy(sphere.vertices).float(), torch.from_numpy(sphere.faces).long())


def camera(target: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Camera:
    eye = torch.tensor(target) + torch.tensor([0.0, 0.0, DISTANCE])
    return Camera.look_at(eye, torch.tensor(target), DISTANCE / PIXEL, (SIDE, SIDE))


def shown(seen: Camera, radius: float) -> np.ndarray:
    mesh = ball(radius)
    return (rasterise_triangles(mesh.vertices, mesh.faces, seen).face >= 0).numpy().astype(np.float32)


@pytest.mark.parametrize("person", [0.085, 0.10, 0.12])
def test_gap_is_the_difference_of_the_radii(person: float):
    seen = camera()
    contour = Outline.of(seen, shown(seen, person), SIDE).contour(ball(RADIUS))
    assert len(contour.gap) > 2 * math.pi * RADIUS / PIXEL * 0.8
    assert float((contour.gap - (RADIUS - person)).abs().max()) < 1.0 * PIXEL
    assert abs(float(contour.gap.mean()) - (RADIUS - person)) < 0.4 * PIXEL
    middle = torch.stack([contour.column, contour.row], dim=1) + 0.5 - SIDE / 2
    radial = torch.nn.functional.normalize(middle, dim=1)
    assert float((contour.outward * radial).sum(dim=1).min()) > 0.9
    if person != RADIUS:
        assert float((contour.away * radial).sum(dim=1).min()) > 0.9
    at_person = (contour.nearest.flip(1) + 0.5 - SIDE / 2).norm(dim=1) * PIXEL
    assert float((at_person - person).abs().max()) < 1.5 * PIXEL


def test_half_the_resolution_gives_the_same_gap():
    seen = camera()
    contour = Outline.of(seen, shown(seen, 0.12), SIDE // 2).contour(ball(RADIUS))
    assert abs(float(contour.gap.mean()) + 0.02) < 0.4 * (2 * PIXEL)


def test_points_near_the_border_of_the_picture_are_left_out():
    """The person's outline is out of sight on one side, where nothing may be concluded from it."""
    seen = camera((0.09, 0.0, 0.0))
    contour = Outline.of(seen, shown(seen, 0.12), SIDE).contour(ball(RADIUS))
    x = (contour.column + 0.5 - SIDE / 2) * PIXEL + 0.09
    assert float((contour.gap + 0.02).abs().max()) < 1.5 * PIXEL
    assert float(x.min()) > -0.097
    assert float(x.max()) > 0.095
