"""Charts: injective for any set of faces, nearly isometric on scalps; overlaps are found and named."""

import json

import numpy as np
import pytest
import torch

from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.chart import chart_faces, tutte_embedding
from neural_strands.scalp.chart_relax import _energy, _rest_shapes, is_simple
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.mesh_file import read_mesh_file
from neural_strands.scalp.overlap import overlapping_faces
from neural_strands.scalp.patches import disk, pieces


def uv_areas(uv):
    """Signed areas of uv triangles."""
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def assert_injective(uv):
    assert torch.isfinite(uv).all()
    assert (uv >= 0).all()
    assert (uv <= 1).all()
    assert (uv_areas(uv) > 0).all()
    assert len(overlapping_faces(uv)) == 0


def grid_mesh(rows, columns, height=None):
    """A rectangle of squares cut in two, lying in the plane y = height(x, z), facing +y."""
    x, z = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0), indexing="xy")
    y = np.zeros_like(x) if height is None else height(x, z)
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    faces = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return Mesh(torch.from_numpy(np.stack([x, y, z], -1).reshape(-1, 3)).float(), torch.from_numpy(faces))


def everything(mesh):
    return torch.arange(len(mesh.faces))


def test_a_flat_rectangle_stays_a_rectangle():
    mesh = grid_mesh(4, 6)
    uv = chart_faces(mesh, everything(mesh))
    assert_injective(uv)
    # Isometric up to one scale, u along +x, v along -z.
    scale = uv_areas(uv).sum() / 24
    expected = torch.stack([mesh.corners()[..., 0], -mesh.corners()[..., 2]], dim=-1) * scale.sqrt()
    difference = uv - expected
    torch.testing.assert_close(difference - difference.mean(dim=(0, 1)), torch.zeros_like(uv), atol=2e-3, rtol=0)


def test_two_pieces_do_not_touch():
    one = grid_mesh(3, 3)
    other = grid_mesh(2, 5)
    mesh = Mesh(torch.cat([one.vertices, other.vertices + 50]), torch.cat([one.faces, other.faces + len(one.vertices)]))
    uv = chart_faces(mesh, everything(mesh))
    assert_injective(uv)
    areas = uv_areas(uv) / face_areas(mesh)
    torch.testing.assert_close(areas, areas.mean().expand_as(areas), rtol=0.05, atol=0)


def test_holes_are_kept_open():
    mesh = grid_mesh(8, 8, lambda x, z: 0.1 * (x - 4) ** 2)
    centre = mesh.corners().mean(dim=1)
    ring = ((centre[:, 0] - 4).abs() > 1.2) | ((centre[:, 2] - 4).abs() > 1.2)
    uv = chart_faces(mesh, torch.nonzero(ring).squeeze(1))
    assert_injective(uv)
    hole = uv.reshape(-1, 2).sub(0.5).norm(dim=1).min()
    assert hole > 0.05


def test_closed_meshes_and_handles_are_cut():
    u, v = np.meshgrid(np.arange(12), np.arange(8), indexing="ij")
    a, b = 2 * np.pi * u / 12, 2 * np.pi * v / 8
    torus = np.stack([(3 + np.cos(b)) * np.cos(a), np.sin(b), (3 + np.cos(b)) * np.sin(a)], -1).reshape(-1, 3)
    number = np.arange(96).reshape(12, 8)
    p, q = number, np.roll(number, -1, 0)
    r, s = np.roll(q, -1, 1), np.roll(p, -1, 1)
    faces = np.concatenate([np.stack([p, s, r], -1).reshape(-1, 3), np.stack([p, r, q], -1).reshape(-1, 3)])
    mesh = Mesh(torch.from_numpy(torus).float(), torch.from_numpy(faces))
    assert_injective(chart_faces(mesh, everything(mesh)))


def test_edges_of_three_faces_and_touching_vertices():
    vertices = torch.tensor(
        [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0.5, 0, 1], [2, 1, 0], [2, -1, 0.5], [1, 0, 3]]
    )
    # Three faces on the edge 0-1, another pair that touches them only in vertex 1, and a face given twice.
    faces = torch.tensor([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 5, 6], [1, 6, 7], [1, 6, 7]])
    assert_injective(chart_faces(Mesh(vertices, faces), torch.arange(6)))


@pytest.mark.parametrize("seed", range(5))
def test_any_subset_of_a_head_is_charted_without_overlap(seed):
    head = mannequin()
    near = head.mesh.corners().mean(dim=1)
    generator = torch.Generator().manual_seed(seed)
    centre = near[torch.randint(len(near), (1,), generator=generator)]
    ball = (near - centre).norm(dim=1) < 0.02 + 0.02 * torch.rand(1, generator=generator)
    ragged = ball & (torch.rand(len(near), generator=generator) < 0.9)
    assert_injective(chart_faces(head.mesh, torch.nonzero(ragged).squeeze(1)))


@pytest.mark.parametrize("name", ["sintel_bob", "straight_long"])
def test_scalps_of_captures(shared_data, name):
    folder = shared_data / "captures" / name
    mesh = read_mesh_file(folder / "head.obj").mesh
    faces = torch.tensor(json.loads((folder / "scalp_faces.json").read_text()))
    uv = chart_faces(mesh, faces)
    assert_injective(uv)
    stretch = uv_areas(uv) / face_areas(Mesh(mesh.vertices, mesh.faces[faces]))
    low, high = torch.quantile(stretch / stretch.median(), torch.tensor([0.05, 0.95]))
    assert low > 0.5
    assert high < 2.6


def test_mannequin_chart_is_moderately_stretched():
    head = mannequin()
    assert_injective(head.scalp_uv)
    stretch = uv_areas(head.scalp_uv) / face_areas(head.scalp_mesh)
    stretch = stretch / (uv_areas(head.scalp_uv).sum() / head.scalp_area)
    low, high = torch.quantile(stretch, torch.tensor([0.02, 0.98]))
    assert low > 0.6
    assert high < 1.7


def test_chart_runs_right_and_back():
    head = mannequin()
    uv, place = head.scalp_uv.mean(dim=1), head.scalp_mesh.corners().mean(dim=1)
    for axis, along in ((0, place[:, 0]), (1, -place[:, 2])):
        assert torch.corrcoef(torch.stack([uv[:, axis], along]))[0, 1] > 0.85


def test_overlap_check_against_shapes_of_known_answer():
    square = torch.tensor([[[0.0, 0], [1, 0], [0, 1]], [[1, 0], [1, 1], [0, 1]]])
    assert len(overlapping_faces(square)) == 0
    folded = torch.tensor([[[0.0, 0], [1, 0], [0, 1]], [[1, 0], [0.1, 0.1], [0, 1]]])
    assert overlapping_faces(folded).tolist() == [[0, 1]]
    inside = torch.tensor([[[0.0, 0], [1, 0], [0, 1]], [[0.2, 0.2], [0.3, 0.2], [0.2, 0.3]], [[2, 2], [3, 2], [2, 3]]])
    assert overlapping_faces(inside).tolist() == [[0, 1]]
    assert len(overlapping_faces(torch.zeros(0, 3, 2))) == 0


def test_overlap_check_against_sampling(generator):
    """Random triangles: every overlap that sampling finds is found, except for slivers."""
    uv = torch.rand(40, 3, 2, generator=generator) * 0.2 + torch.rand(40, 1, 2, generator=generator)
    random = torch.rand(400, 3, generator=generator).add(1e-3).log().neg()
    samples = torch.einsum("sk,fkc->fsc", random / random.sum(-1, keepdim=True), uv)
    a, b, c = uv.unbind(1)

    def side(p, q, r):
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    inside = torch.stack([side(p, q, samples[:, :, None]) for p, q in ((a, b), (b, c), (c, a))])
    hit = ((inside > 0).all(dim=0) | (inside < 0).all(dim=0)).any(dim=1)
    expected = {(min(i, j), max(i, j)) for i, j in torch.nonzero(hit).tolist() if i != j}
    found = {tuple(pair) for pair in overlapping_faces(uv).tolist()}
    assert expected <= found
    assert len(found - expected) <= 0.1 * len(found)


def test_energy_gradient_matches_differences():
    mesh = grid_mesh(3, 3, lambda x, z: 0.3 * x * z)
    rng = np.random.default_rng(0)
    uv = mesh.vertices.numpy()[:, [0, 2]].astype(float) * [1, -1] + 0.1 * rng.standard_normal((16, 2))
    triangles = mesh.faces.numpy()
    inverse, area = _rest_shapes(mesh.vertices.double().numpy()[triangles])
    value, gradient = _energy(uv, triangles, inverse, area)
    assert np.isfinite(value)
    move = 1e-6 * rng.standard_normal(uv.shape)
    forward, backward = (_energy(uv + sign * move, triangles, inverse, area)[0] for sign in (1, -1))
    np.testing.assert_allclose((forward - backward) / 2, (gradient * move).sum(), rtol=1e-4)


def test_tutte_of_a_disk_is_injective():
    mesh = grid_mesh(7, 9, lambda x, z: np.sin(x) + np.cos(2 * z))
    faces = mesh.faces.numpy()
    (piece,) = pieces(faces)
    patch = disk(mesh.vertices.double().numpy(), faces, piece)
    uv = torch.from_numpy(tutte_embedding(patch.triangles, patch.boundary, patch.positions))
    assert (uv_areas(uv[torch.from_numpy(patch.triangles)]) > 0).all()


def test_is_simple():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    assert is_simple(square)
    assert not is_simple(square[[0, 2, 1, 3]])
