"""Roots: exact counts, blue noise, even density, orthonormal smooth frames, attachment."""

import math

import pytest
import torch
from scipy.spatial import KDTree

from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.blue_noise import eliminate, throw_darts
from neural_strands.scalp.head import Head, scalp_vertex_frames
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.roots import attach_roots, roots_at, sample_roots


def seeded(seed=0):
    return torch.Generator().manual_seed(seed)


def square_head(side=1.0):
    """A flat square facing +y whose chart is the identity (u = x, v = -z + side)."""
    vertices = torch.tensor([[0.0, 0, 0], [side, 0, 0], [side, 0, -side], [0, 0, -side]])
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    uv = torch.stack([vertices[:, 0], -vertices[:, 2]], dim=-1)[faces] / side
    return Head(Mesh(vertices, faces), torch.arange(2), uv)


def nearest(positions):
    return torch.from_numpy(KDTree(positions.numpy()).query(positions.numpy(), k=2)[0][:, 1])


@pytest.mark.parametrize("count", [1, 7, 100, 2345])
def test_count_is_exact_and_seeds_repeat(count):
    head = mannequin()
    first, again = sample_roots(head, count, seeded(3)), sample_roots(head, count, seeded(3))
    assert len(first) == count
    assert torch.equal(first.position, again.position)
    assert torch.equal(first.frame, again.frame)
    other = sample_roots(head, count, seeded(4))
    assert not torch.equal(first.position, other.position)


def test_count_must_be_positive():
    with pytest.raises(ValueError, match="positive"):
        sample_roots(mannequin(), 0, seeded())


def test_blue_noise_statistics():
    """In a random sample, the nearest neighbour is 0.5 / sqrt(density) away, with a spread of 52 %; here not."""
    head, count = square_head(), 4000
    gaps = nearest(sample_roots(head, count, seeded()).position)
    hexagonal = math.sqrt(2 / (math.sqrt(3) * count))
    assert gaps.min() > 0.609 * hexagonal
    assert gaps.mean() > 0.72 * hexagonal
    assert gaps.std() / gaps.mean() < 0.13
    random = nearest(torch.rand(count, 3, generator=seeded()) * torch.tensor([1.0, 0.0, 1.0]))
    assert random.std() / random.mean() > 0.4


def test_density_is_even_over_the_scalp():
    head, count = mannequin(), 20_000
    roots = sample_roots(head, count, seeded())
    centres = head.scalp_mesh.corners().mean(dim=1)
    # Patches of about a fiftieth of the scalp each: their shares of the area and of the roots.
    seeds = KDTree(sample_roots(head, 50, seeded(1)).position.numpy())
    share = torch.zeros(50).index_add(0, torch.from_numpy(seeds.query(centres.numpy())[1]), face_areas(head.scalp_mesh))
    found = torch.bincount(torch.from_numpy(seeds.query(roots.position.numpy())[1]), minlength=50) / count
    torch.testing.assert_close(found, share / share.sum(), rtol=0.1, atol=0)


def test_first_roots_are_spread_too():
    roots = sample_roots(mannequin(), 5000, seeded())
    assert (roots.position[:500].mean(dim=0) - roots.position.mean(dim=0)).norm() < 0.008


def test_frames_are_orthonormal_right_handed_and_outward():
    head = mannequin()
    roots = sample_roots(head, 3000, seeded())
    identity = torch.eye(3).expand(3000, 3, 3)
    torch.testing.assert_close(roots.frame.transpose(1, 2) @ roots.frame, identity, atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.det(roots.frame), torch.ones(3000), atol=1e-5, rtol=0)
    outward = roots.position - torch.tensor([0.0, 0.02, -0.01])
    assert ((roots.normal * torch.nn.functional.normalize(outward, dim=-1)).sum(-1) > 0.3).all()


def test_frames_vary_smoothly():
    roots = sample_roots(mannequin(), 20_000, seeded())
    partner = torch.from_numpy(KDTree(roots.position.numpy()).query(roots.position.numpy(), k=2)[1])[:, 1]
    alike = torch.einsum("rij,rij->ri", roots.frame.transpose(1, 2), roots.frame[partner].transpose(1, 2))
    assert alike.quantile(0.001) > 0.95
    assert alike.min() > 0.5


def test_frame_of_a_flat_chart_in_closed_form():
    roots = sample_roots(square_head(2.0), 50, seeded())
    torch.testing.assert_close(roots.frame[0], torch.tensor([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))
    torch.testing.assert_close(roots.uv, torch.stack([roots.position[:, 0], -roots.position[:, 2]], dim=-1) / 2)


def test_tangents_do_not_mix_across_seams():
    head = square_head()
    # The second face's chart is turned by a right angle and moved away.
    turned = torch.stack([head.scalp_uv[1, :, 1], -head.scalp_uv[1, :, 0]], dim=-1)
    split = Head(head.mesh, head.scalp_faces, torch.stack([head.scalp_uv[0], turned + 5]))
    _, tangents = scalp_vertex_frames(split)
    torch.testing.assert_close(tangents[0], torch.tensor([[1.0, 0, 0]]).expand(3, 3))
    torch.testing.assert_close(tangents[1], torch.tensor([[0.0, 0, -1]]).expand(3, 3))


def test_attaching_sampled_roots_finds_them_again():
    head = mannequin()
    roots = sample_roots(head, 500, seeded())
    found = attach_roots(head, roots.position)
    assert found.distance.max() < 1e-6
    torch.testing.assert_close(found.uv, roots.uv, atol=1e-4, rtol=0)
    torch.testing.assert_close(found.frame, roots.frame, atol=5e-3, rtol=0)


def test_attaching_keeps_positions_and_tells_distances():
    head = mannequin()
    roots = sample_roots(head, 300, seeded())
    lifted = roots.position + 0.004 * roots.normal
    found = attach_roots(head, lifted)
    assert torch.equal(found.position, lifted)
    assert (found.distance <= 0.004 + 1e-6).all()
    assert found.distance.median() > 0.0035


def test_elimination_keeps_all_when_all_are_wanted():
    points = torch.rand(20, 3, generator=seeded())
    assert eliminate(points, 20, 1e9).tolist() == list(range(20))


def test_roots_at_corners_are_the_vertices():
    head = mannequin()
    face = torch.arange(10)
    roots = roots_at(head, face, torch.tensor([[1.0, 0, 0]]).expand(10, 3))
    torch.testing.assert_close(roots.position, head.scalp_mesh.corners()[face, 0])


def test_joined_roots_keep_their_order():
    roots = sample_roots(mannequin(), 30, seeded())
    joined = roots.select(torch.arange(12)).joined(roots.select(torch.arange(12, 30)))
    for name in ("position", "uv", "frame", "distance"):
        assert torch.equal(getattr(joined, name), getattr(roots, name))


def test_darts_keep_their_distance_and_leave_no_room():
    points, radius = torch.rand(800, 3, generator=seeded()), 0.12
    kept = throw_darts(points, radius)
    # The same as throwing them one by one.
    one_by_one: list[int] = []
    for k, point in enumerate(points):
        if not one_by_one or (points[one_by_one] - point).norm(dim=1).min() > radius:
            one_by_one.append(k)
    assert kept.tolist() == one_by_one
    assert 100 < len(kept) < 700


def test_nothing_to_throw():
    assert len(throw_darts(torch.zeros(0, 3), 0.1)) == 0
