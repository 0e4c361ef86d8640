"""Meshes: a tetrahedron computed by hand, a sphere by its formula."""

import math

import pytest
import torch
import trimesh

from neural_strands.geometry.mesh import (
    Mesh,
    barycentric_coordinates,
    face_areas,
    face_normals,
    interpolate,
    vertex_normals,
)


def sphere() -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=2.0)
    return Mesh(torch.tensor(ball.vertices, dtype=torch.float64), torch.tensor(ball.faces, dtype=torch.int64))


def test_triangle_by_hand():
    """Legs 2 and 3 in the plane z = 1, counter-clockwise from above."""
    mesh = Mesh(torch.tensor([[0.0, 0, 1], [2, 0, 1], [0, 3, 1]]), torch.tensor([[0, 1, 2]]))
    assert face_areas(mesh).tolist() == [3.0]
    assert face_normals(mesh).tolist() == [[0.0, 0.0, 1.0]]


def test_degenerate_face_has_no_normal():
    mesh = Mesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), torch.tensor([[0, 1, 2]]))
    assert face_normals(mesh).tolist() == [[0.0, 0.0, 0.0]]
    assert face_areas(mesh).tolist() == [0.0]


def test_sphere_area_and_normals():
    mesh = sphere()
    assert float(face_areas(mesh).sum()) == pytest.approx(16 * math.pi, rel=0.01)
    cosine = (vertex_normals(mesh) * mesh.vertices / 2.0).sum(-1)
    assert (cosine > 0.999).all()


def test_barycentric_round_trip(generator: torch.Generator):
    mesh = sphere()
    weights = torch.rand(300, 3, generator=generator, dtype=torch.float64)
    weights = weights / weights.sum(dim=1, keepdim=True)
    face = torch.randint(len(mesh.faces), (300,), generator=generator)
    points = interpolate(mesh.corners(), face, weights)
    torch.testing.assert_close(barycentric_coordinates(points, mesh.corners()[face]), weights)


def test_barycentric_in_the_plane_of_a_chart():
    corners = torch.tensor([[[0.0, 0], [1, 0], [0, 1]]])
    found = barycentric_coordinates(torch.tensor([[0.25, 0.5]]), corners)
    torch.testing.assert_close(found, torch.tensor([[0.25, 0.25, 0.5]]))
    outside = barycentric_coordinates(torch.tensor([[1.0, 1.0]]), corners)
    torch.testing.assert_close(outside, torch.tensor([[-1.0, 1, 1]]))


def test_points_off_the_plane_are_projected():
    corners = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    found = barycentric_coordinates(torch.tensor([[0.25, 0.5, 7.0]]), corners)
    torch.testing.assert_close(found, torch.tensor([[0.25, 0.25, 0.5]]))


def test_interpolation_at_corners_gives_corner_values(generator: torch.Generator):
    values = torch.randn(4, 3, 5, generator=generator)
    face = torch.tensor([2, 0, 3])
    found = interpolate(values, face, torch.eye(3))
    torch.testing.assert_close(found, torch.stack([values[2, 0], values[0, 1], values[3, 2]]))


def test_moving_a_mesh_moves_its_chart(device: torch.device):
    mesh = Mesh(torch.zeros(3, 3), torch.tensor([[0, 1, 2]]), torch.zeros(1, 3, 2)).to(device)
    assert mesh.corner_uv is not None
    assert mesh.corner_uv.device.type == device.type
    assert mesh.faces.device.type == device.type
