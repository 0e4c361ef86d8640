"""Values extended over a mesh, compared with a dense least-squares solution, and what must hold for any values."""

import pytest
import torch
from scipy.spatial import Delaunay

from neural_strands.geometry.mesh import Mesh
from neural_strands.model.surround.hidden_skin import HELD, HIDDEN, MEAN, SEEN, extend_over_mesh, known_share


def patch(count=60, seed=0):
    """A triangulated square with random vertices."""
    random = torch.Generator().manual_seed(seed)
    flat = torch.rand(count, 2, generator=random)
    vertices = torch.cat([flat, torch.zeros(count, 1)], dim=1)
    return Mesh(vertices, torch.from_numpy(Delaunay(flat.numpy()).simplices).long())


def edges(mesh):
    return {tuple(sorted((face[k], face[k - 1]))) for face in mesh.faces.tolist() for k in range(3)}


def test_values_are_the_smoothest_that_keep_to_what_is_known():
    mesh, random = patch(), torch.Generator().manual_seed(1)
    values = torch.rand(60, 2, generator=random)
    known = torch.rand(60, generator=random) * (torch.rand(60, generator=random) < 0.3)
    # Least squares with one row for every edge, every known value and the mean.
    rows, right = [], []
    mean = (known[:, None] * values).sum(dim=0) / known.sum()
    for first, second in edges(mesh):
        row = torch.zeros(60, dtype=torch.float64)
        row[first], row[second] = 1.0, -1.0
        rows.append(row)
        right.append(torch.zeros(2, dtype=torch.float64))
    for weights, wanted in ((HELD * known, values), (torch.full((60,), MEAN), mean.expand(60, 2))):
        rows += [*torch.diag(weights.double().sqrt())]
        right += [*(weights.double().sqrt()[:, None] * wanted.double())]
    expected = torch.linalg.lstsq(torch.stack(rows), torch.stack(right)).solution
    torch.testing.assert_close(extend_over_mesh(values, known, mesh).double(), expected, atol=1e-4, rtol=0)


def test_what_is_not_known_lies_between_what_is_and_does_not_count():
    mesh = patch()
    known = (mesh.vertices[:, 0] < 0.3).float()
    values = torch.where(known[:, None] > 0, 0.4 + 0.2 * mesh.vertices[:, 1:2], torch.nan)
    found = extend_over_mesh(values, known, mesh)
    assert float(found.min()) >= 0.4 - 1e-4
    assert float(found.max()) <= 0.6 + 1e-4


def test_a_part_on_its_own_takes_the_mean_and_without_any_known_value_all_stays():
    one = patch(20)
    mesh = Mesh(torch.cat([one.vertices, one.vertices + 5]), torch.cat([one.faces, one.faces + 20]))
    known = torch.cat([torch.ones(20), torch.zeros(20)])
    values = torch.rand(40, 3, generator=torch.Generator().manual_seed(2))
    found = extend_over_mesh(values, known, mesh)
    torch.testing.assert_close(found[20:], values[:20].mean(dim=0).expand(20, 3), atol=1e-4, rtol=0)
    assert extend_over_mesh(values, torch.zeros(40), mesh) is values


def test_places_are_known_by_how_freely_they_are_seen():
    free = torch.tensor([0.0, HIDDEN, 0.5 * (HIDDEN + SEEN), SEEN, 1.0])
    assert known_share(free).tolist() == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0])
