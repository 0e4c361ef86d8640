"""Pushing strands out of a sphere, whose distance has a closed form."""

import torch
import trimesh

from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import segments
from neural_strands.synthesis.collision import CLEARANCE, integrate_again, keep_outside

RADIUS = 0.08


def _ball() -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    return Mesh(torch.tensor(ball.vertices).float(), torch.tensor(ball.faces).long())


def _through_the_ball(generator: torch.Generator) -> torch.Tensor:
    root = torch.nn.functional.normalize(torch.randn(60, 3, generator=generator), dim=-1) * RADIUS
    heading = torch.nn.functional.normalize(-root + 0.02 * torch.randn(60, 3, generator=generator), dim=-1)
    return root[:, None] + heading[:, None] * torch.linspace(0, 0.2, 100)[:, None]


def test_strands_through_the_ball_end_outside_with_their_roots_kept(generator):
    strands = _through_the_ball(generator)
    mesh = _ball()
    kept = keep_outside(strands, SignedDistanceGrid.build(mesh, 0.006), mesh)
    assert torch.equal(kept[:, 0], strands[:, 0])
    # The faceted ball lies up to a few micrometres inside the round one.
    later = kept[:, 5:].norm(dim=-1) - RADIUS
    assert later.min() > CLEARANCE - 1e-4


def test_strands_through_a_thin_plate_go_around_or_end_before_it():
    plate = trimesh.creation.box(extents=(0.08, 0.003, 0.08)).subdivide().subdivide().subdivide()
    mesh = Mesh(torch.tensor(plate.vertices).float(), torch.tensor(plate.faces).long())
    place = torch.linspace(-0.035, 0.035, 15)
    height = torch.linspace(0.03, -0.05, 100)
    strands = torch.stack(torch.broadcast_tensors(place[:, None], height[None], torch.tensor(0.0)), dim=-1)
    kept = keep_outside(strands.contiguous(), SignedDistanceGrid.build(mesh, 0.006), mesh)
    fine = torch.cat([torch.lerp(kept[:, :-1], kept[:, 1:], t) for t in (0.0, 0.25, 0.5, 0.75)], dim=1)
    inside = (fine[..., 0].abs() < 0.0399) & (fine[..., 1].abs() < 0.0014) & (fine[..., 2].abs() < 0.0399)
    assert not inside.any()
    assert torch.equal(kept[:, 0], strands[:, 0])


def test_strands_that_touch_nothing_are_left_alone(generator):
    strands = _through_the_ball(generator) * torch.tensor([1.0, 1.0, 1.0]) + torch.tensor([1.0, 0.0, 0.0])
    mesh = _ball()
    assert torch.equal(keep_outside(strands, SignedDistanceGrid.build(mesh, 0.006), mesh), strands)


def test_integrating_again_keeps_lengths_and_direct_targets(generator):
    strands = _through_the_ball(generator)
    lengths = segments(strands).norm(dim=-1)
    assert torch.allclose(integrate_again(strands, lengths), strands, atol=1e-6)
    moved = strands + 0.004 * torch.randn(strands.shape, generator=generator)
    again = integrate_again(moved, lengths)
    assert torch.allclose(segments(again).norm(dim=-1), lengths, atol=1e-6)
