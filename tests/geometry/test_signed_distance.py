"""Closest points and signed distances against closed forms and the brute-force twins."""

import json
import math

import pytest
import torch
import trimesh

from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex, closest_points, closest_points_reference
from neural_strands.geometry.signed_distance import (
    SignedDistanceIndex,
    signed_distance,
    signed_distance_reference,
    winding_number,
)
from neural_strands.geometry.voxel_grid import sample_reference
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.mesh_file import read_mesh_file


def cube(side: float = 2.0) -> Mesh:
    """An axis-aligned cube about the origin, faces outwards."""
    x = side / 2
    corners = torch.tensor([[a, b, c] for a in (-x, x) for b in (-x, x) for c in (-x, x)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[q[0], q[1], q[2]] for q in quads] + [[q[0], q[2], q[3]] for q in quads]
    return Mesh(corners, torch.tensor(faces))


def cube_distance(points: torch.Tensor, side: float = 2.0) -> torch.Tensor:
    """Closed form for the cube."""
    q = points.abs() - side / 2
    return q.clamp(min=0).norm(dim=-1) + q.amax(dim=-1).clamp(max=0)


def test_cube_matches_its_closed_form(device, generator):
    points = (4 * torch.rand(5000, 3, generator=generator) - 2).to(device)
    found = signed_distance(points, cube().to(device))
    torch.testing.assert_close(found.distance, cube_distance(points), atol=1e-5, rtol=0)
    torch.testing.assert_close(found.normal.norm(dim=-1), torch.ones(5000, device=device))
    # Going back along the normal by the distance ends on the surface.
    foot = points - found.distance[:, None] * found.normal
    torch.testing.assert_close(foot, found.closest, atol=1e-5, rtol=0)


def test_twins_agree(device, generator):
    head = mannequin().mesh.to(device)
    points = (torch.rand(60, 3, generator=generator) * 0.4 - 0.2).to(device)
    fast, slow = signed_distance(points, head), signed_distance_reference(points, head)
    torch.testing.assert_close(fast.distance, slow.distance, atol=1e-6, rtol=0)
    torch.testing.assert_close(fast.closest, slow.closest, atol=2e-4, rtol=0)
    assert (fast.distance < 0).any()
    assert (fast.distance > 0).any()


def test_closest_points_on_a_lone_triangle():
    mesh = Mesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), torch.tensor([[0, 1, 2]]))
    # Above the inside, beyond an edge, beyond a corner.
    points = torch.tensor([[0.25, 0.25, 1.0], [0.5, -2.0, 0.0], [3.0, -1.0, 0.0]])
    for found in (closest_points(points, mesh), closest_points_reference(points, mesh)):
        torch.testing.assert_close(found.position, torch.tensor([[0.25, 0.25, 0.0], [0.5, 0, 0], [1, 0, 0]]))
        torch.testing.assert_close(found.distance, torch.tensor([1.0, 2.0, math.sqrt(5.0)]))
        torch.testing.assert_close(found.barycentric.sum(dim=-1), torch.ones(3))


def test_gradient_is_the_outward_direction(generator):
    points = (4 * torch.rand(300, 3, generator=generator, dtype=torch.float64) - 2).requires_grad_()
    index = SignedDistanceIndex(cube())
    found = index(points)
    (gradient,) = torch.autograd.grad(found.distance.sum(), points)
    # Central differences of the closed form, away from the cube's medial axes.
    step = 1e-6 * torch.eye(3, dtype=torch.float64)
    numeric = torch.stack([(cube_distance(points + s) - cube_distance(points - s)) / 2e-6 for s in step], dim=-1)
    smooth = (numeric.norm(dim=-1) - 1).abs() < 1e-4
    assert smooth.float().mean() > 0.9
    torch.testing.assert_close(gradient[smooth], numeric[smooth].detach(), atol=1e-4, rtol=0)


def test_penalty_pushes_points_out():
    index = SignedDistanceIndex(cube())
    points = torch.tensor([[0.9, 0.1, 0.2], [0.0, 0.3, -0.8]], requires_grad=True)
    optimiser = torch.optim.SGD([points], lr=0.1)
    for _ in range(40):
        optimiser.zero_grad()
        torch.relu(-index(points).distance).sum().backward()
        optimiser.step()
    assert (index(points).distance >= -1e-6).all()


def test_empty_and_surface_points():
    index = SignedDistanceIndex(cube())
    assert index(torch.zeros(0, 3)).distance.shape == (0,)
    on_face = index(torch.tensor([[1.0, 0.2, 0.3]]))
    torch.testing.assert_close(on_face.distance, torch.zeros(1))
    torch.testing.assert_close(on_face.normal, torch.tensor([[1.0, 0.0, 0.0]]))


def test_empty_mesh_is_refused():
    with pytest.raises(ValueError, match="at least one face"):
        MeshIndex(Mesh(torch.zeros(3, 3), torch.zeros(0, 3, dtype=torch.int64)))


def test_winding_number_of_a_closed_mesh_is_one_inside_and_zero_outside(generator):
    points = 4 * torch.rand(500, 3, generator=generator) - 2
    inside = cube_distance(points) < 0
    torch.testing.assert_close(winding_number(points, cube()), inside.float(), atol=1e-5, rtol=0)


def test_open_bust_keeps_its_sign_about_the_head(generator):
    """The mannequin without its bottom: above the neck, no sign changes."""
    mesh = mannequin().mesh
    high = (mesh.corners()[..., 1] > -0.26).all(dim=-1)
    open_bust = Mesh(mesh.vertices, mesh.faces[high])
    points = torch.rand(4000, 3, generator=generator) * 0.3 - 0.15
    closed, opened = signed_distance(points, mesh), signed_distance(points, open_bust)
    assert ((closed.distance < 0) == (opened.distance < 0)).float().mean() > 0.999


@pytest.mark.parametrize("name", ["sintel_bob", "straight_long"])
def test_capture_heads_are_solid_under_the_scalp(shared_data, name):
    folder = shared_data / "captures" / name
    mesh = read_mesh_file(folder / "head.obj").mesh
    scalp = torch.tensor(json.loads((folder / "scalp_faces.json").read_text()))
    corners = mesh.corners()[scalp]
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1)
    normal = torch.nn.functional.normalize(normal, dim=-1)
    centre = corners.mean(dim=1)
    assert (signed_distance(centre + 0.001 * normal, mesh).distance > 0).float().mean() > 0.97
    assert (signed_distance(centre - 0.001 * normal, mesh).distance < 0).float().mean() > 0.97


def test_grid_is_close_to_the_mesh_and_to_its_twin(generator):
    mesh = cube(0.2)
    grid = SignedDistanceGrid.build(mesh, spacing=0.01, margin=0.03)
    points = (torch.rand(3000, 3, generator=generator) * 0.3 - 0.15).requires_grad_()
    value = grid(points)
    twin = sample_reference(grid.grid, grid.values[..., None], points, "border")[:, 0]
    torch.testing.assert_close(value, twin, atol=1e-6, rtol=0)
    weights = torch.randn(3000, generator=generator)
    gradients = [torch.autograd.grad((v * weights).sum(), points)[0] for v in (value, twin)]
    torch.testing.assert_close(gradients[0], gradients[1], atol=1e-4, rtol=0)
    within = (points.abs() < 0.125).all(dim=-1)
    # Where the field has creases, the trilinear error is at most the distance within a cell.
    assert (value - cube_distance(points, 0.2))[within].abs().max() < 0.005
    assert (value - cube_distance(points, 0.2))[within].abs().mean() < 0.0005


def test_a_grid_is_as_exact_as_it_says_and_knows_which_way_is_out(generator):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.08)
    mesh = Mesh(torch.tensor(ball.vertices).float(), torch.tensor(ball.faces).long())
    grid = SignedDistanceGrid.build(mesh, spacing=0.006)
    points = (torch.rand(2000, 3, generator=generator) - 0.5) * 0.2
    distance, outward = grid.with_outward(points)
    exact = points.norm(dim=-1) - 0.08
    assert (distance - exact).abs().max() < grid.largest_error
    torch.testing.assert_close(distance, grid(points), atol=1e-5, rtol=0)
    near = exact.abs() < 0.02
    radial = torch.nn.functional.normalize(points, dim=-1)
    assert ((outward * radial).sum(dim=-1)[near] > 0.97).all()
    far, ahead = grid.with_outward(torch.tensor([[0.0, 5.0, 0.0], [3.0, 0.0, 0.0]]))
    assert (far < 0.03).all()
    torch.testing.assert_close(ahead, torch.tensor([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), atol=0.05, rtol=0)


@pytest.mark.parametrize("spacing", [0.006, 0.011, 0.05])
def test_nodes_of_a_grid_have_the_sign_of_the_winding_number(spacing):
    mesh = mannequin().mesh
    closed = trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy()).convex_hull
    mesh = Mesh(torch.tensor(closed.vertices).float(), torch.tensor(closed.faces).long())
    grid = SignedDistanceGrid.build(mesh, spacing)
    exact = signed_distance(grid.grid.nodes().reshape(-1, 3), mesh).distance.reshape(grid.grid.shape)
    torch.testing.assert_close(grid.values, exact, atol=1e-6, rtol=0)
    assert (grid.values < 0).any()


@pytest.mark.parametrize("depth", [0.002, 0.02])
def test_a_grid_knows_what_lies_deeper_as_exactly_as_the_mesh(generator, depth):
    """Also around an open neck, where the sign changes far from any surface."""
    whole = mannequin().mesh
    mesh = Mesh(whole.vertices, whole.faces[(whole.corners()[..., 1] > -0.26).all(dim=-1)])
    grid = SignedDistanceGrid.build(mesh, 0.006)
    low, high = (edge(mesh.vertices, dim=0) for edge in (torch.amin, torch.amax))
    points = (torch.rand(20000, 3, generator=generator) * 1.4 - 0.2) * (high - low) + low
    above = signed_distance(points, mesh).distance > -depth
    assert torch.equal(grid.is_above(points, depth, mesh), above)
    assert 0.5 < above.float().mean() < 0.99


def test_far_from_the_surface_a_grid_may_be_interpolated():
    """Near it, every node is exact, also around an open neck; elsewhere, the error is at most a wide cell."""
    whole = mannequin().mesh
    mesh = Mesh(whole.vertices, whole.faces[(whole.corners()[..., 1] > -0.26).all(dim=-1)])
    grid = SignedDistanceGrid.build(mesh, 0.006, exact_within=0.01)
    exact = signed_distance(grid.grid.nodes().reshape(-1, 3), mesh).distance.reshape(grid.grid.shape)
    near = exact.abs() < 0.01
    torch.testing.assert_close(grid.values[near], exact[near], atol=1e-6, rtol=0)
    error = (grid.values - exact).abs()[~near]
    assert error.max() < 4 * grid.largest_error
    assert (error > 1e-6).float().mean() > 0.1
