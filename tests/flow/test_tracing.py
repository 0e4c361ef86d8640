"""Streamlines against closed forms."""

import math

import torch

from neural_strands.flow.field import FlowField
from neural_strands.flow.tracing import TraceConfig, expected_lengths, trace_hair, trace_strands
from neural_strands.geometry.strands import lengths
from neural_strands.geometry.voxel_grid import VoxelGrid


def test_a_constant_field_gives_straight_strands_that_end_where_the_hair_ends():
    grid = VoxelGrid((0.005, 0.005, 0.005), 0.01, (10, 40, 10))
    down = torch.tensor([0.0, -1.0, 0.0]).expand(*grid.shape, 3)
    domain = torch.zeros(grid.shape, dtype=torch.bool)
    domain[:, 10:] = True  # hair above y = 0.1
    roots = torch.tensor([[0.05, 0.35, 0.05], [0.03, 0.2, 0.07]])
    normals = torch.tensor([[0.0, 1.0, 0.0]]).expand(2, 3)
    strands = trace_strands(FlowField(grid, down, domain), roots, normals, TraceConfig(step=0.001, points=20))
    torch.testing.assert_close(strands[:, 0], roots)
    torch.testing.assert_close(lengths(strands), torch.tensor([0.25, 0.10]), atol=2e-3, rtol=0)
    torch.testing.assert_close(strands[:, -1, 1], torch.full((2,), 0.1), atol=2e-3, rtol=0)
    torch.testing.assert_close(strands[..., 0], roots[:, :1].expand(-1, 20))


def test_a_rotating_field_keeps_its_circles():
    # The tangent field of circles about the y axis: second order integration drifts by far less than a step.
    grid = VoxelGrid((-0.099, 0.001, -0.099), 0.002, (100, 4, 100))
    centres = grid.nodes()
    x, z = centres[..., 0], centres[..., 2]
    tangent = torch.stack([-z, torch.zeros_like(x), x], dim=-1) / (x.square() + z.square()).sqrt()[..., None]
    domain = torch.ones(grid.shape, dtype=torch.bool)
    root = torch.tensor([[0.06, 0.004, 0.0]])
    config = TraceConfig(step=0.0015, longest=0.06 * math.pi, points=50)
    strand = trace_strands(FlowField(grid, tangent, domain), root, torch.tensor([[0.0, 0.0, 1.0]]), config)[0]
    radius = strand[:, [0, 2]].norm(dim=-1)
    torch.testing.assert_close(radius, torch.full((50,), 0.06), atol=2e-4, rtol=0)
    assert abs(float(lengths(strand[None])[0]) - 0.06 * math.pi) < 2e-3


def test_outside_the_hair_a_strand_still_has_its_shortest_length():
    grid = VoxelGrid((0.005, 0.005, 0.005), 0.01, (8, 8, 8))
    up = torch.tensor([0.0, 1.0, 0.0]).expand(*grid.shape, 3)
    domain = torch.zeros(grid.shape, dtype=torch.bool)
    config = TraceConfig(grace=0.0, shortest=0.012)
    strand = trace_strands(FlowField(grid, up, domain), torch.full((1, 3), 0.04), torch.eye(3)[:1], config)
    assert abs(float(lengths(strand)[0]) - 0.012) < 1.6e-3


def test_a_strand_that_leaves_the_grid_ends():
    # Hair reaches the border on every side, so it ends where the grid ends.
    grid = VoxelGrid((0.005, 0.005, 0.005), 0.01, (10, 10, 10))
    behind = torch.tensor([0.0, 0.0, -1.0]).expand(*grid.shape, 3)
    field = FlowField(grid, behind, torch.ones(grid.shape, dtype=torch.bool))
    root = torch.tensor([[0.05, 0.05, 0.04]])
    strand = trace_strands(field, root, torch.tensor([[0.0, 0.0, 1.0]]), TraceConfig(step=0.001))
    assert abs(float(lengths(strand)[0]) - 0.04) < 2e-3


def test_unseen_strands_are_as_long_as_their_neighbours():
    # Seen hair, in the left half, is 10 cm long; in the right half the volume goes on for 30 cm.
    grid = VoxelGrid((0.005, 0.005, 0.005), 0.01, (10, 32, 4))
    down = torch.tensor([0.0, -1.0, 0.0]).expand(*grid.shape, 3)
    domain = torch.ones(grid.shape, dtype=torch.bool)
    domain[:5, :20] = False
    unseen = torch.zeros_like(domain)
    unseen[5:] = True
    x = torch.tensor([0.012, 0.031, 0.052, 0.071, 0.093])
    roots = torch.stack([x, torch.full_like(x, 0.30), torch.full_like(x, 0.02)], dim=-1)
    normals = torch.tensor([[0.0, 1.0, 0.0]]).expand(5, 3)
    found = trace_hair(FlowField(grid, down, domain, unseen), roots, normals, TraceConfig(step=0.001))
    assert found.unseen.tolist() == [0, 0, 1, 1, 1]
    torch.testing.assert_close(lengths(found.points), torch.full((5,), 0.1), atol=3e-3, rtol=0)
    whole = trace_hair(FlowField(grid, down, domain), roots, normals, TraceConfig(step=0.001))
    assert not whole.unseen.any()
    assert (lengths(whole.points)[2:] > 0.28).all()


def test_strands_seen_in_part_are_at_least_as_long_as_what_is_seen():
    # Nobody sees the upper 6 cm of the 20 cm on the left; in the middle, a strand of 3 cm is seen from root to tip. On
    # the right, nobody sees anything below 5 cm, and the volume goes on to 30 cm.
    grid = VoxelGrid((0.005, 0.005, 0.005), 0.01, (10, 32, 4))
    down = torch.tensor([0.0, -1.0, 0.0]).expand(*grid.shape, 3)
    domain, unseen = torch.ones(grid.shape, dtype=torch.bool), torch.zeros(grid.shape, dtype=torch.bool)
    domain[:4, :10], domain[4:6, :27] = False, False
    unseen[:4, 24:], unseen[6:, :25] = True, True
    x = torch.tensor([0.012, 0.031, 0.05, 0.071, 0.093])
    roots = torch.stack([x, torch.full_like(x, 0.30), torch.full_like(x, 0.02)], dim=-1)
    normals = torch.tensor([[0.0, 1.0, 0.0]]).expand(5, 3)
    found = trace_hair(FlowField(grid, down, domain, unseen), roots, normals, TraceConfig(step=0.001))
    length = lengths(found.points)
    torch.testing.assert_close(length[:3], torch.tensor([0.2, 0.2, 0.03]), atol=3e-3, rtol=0)
    assert (length[3:] > 0.05).all()
    assert (length[3:] < 0.205).all()


def test_lengths_expected_of_strands_seen_whole_are_weighted_means(generator):
    roots, seen = torch.rand(50, 3, generator=generator), torch.rand(50, generator=generator)
    whole = torch.ones(50, dtype=torch.bool)
    torch.testing.assert_close(expected_lengths(seen, whole, roots, roots + 1e-5), seen, atol=0.05, rtol=0)
    far = expected_lengths(seen, whole, roots, 10 + torch.rand(4, 3, generator=generator))
    torch.testing.assert_close(far, seen.mean().expand(4), atol=0.05, rtol=0)


def test_lengths_expected_of_strands_cut_off_are_those_of_the_hair(generator):
    # Exponential lengths about 12 cm, of which nobody sees more than 6 cm; from far away all strands weigh alike.
    true = -0.12 * torch.log(1 - torch.rand(2000, generator=generator))
    seen, whole, roots = true.clamp(max=0.06), true < 0.06, 1e-3 * torch.rand(2000, 3, generator=generator)
    (found,) = expected_lengths(seen, whole, roots, torch.tensor([[5.0, 0.0, 0.0]])).tolist()
    assert abs(found - 0.12) < 0.012
    assert float(seen[whole].mean()) < 0.04
