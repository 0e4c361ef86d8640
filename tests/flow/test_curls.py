"""Curls against closed forms of the helix."""

import math

import pytest
import torch

from neural_strands.flow.curls import Curl, Locks, curled, mean_lean, turned_back, wound
from neural_strands.flow.field import FlowField
from neural_strands.flow.surface import surface_normals
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import lengths, segments
from neural_strands.geometry.voxel_grid import VoxelGrid

DOWN = torch.tensor([0.0, -1.0, 0.0])


def straight(count: int, length: float, points: int = 400) -> torch.Tensor:
    """Vertical strands beside each other, root on top."""
    start = 0.02 * torch.arange(count)[:, None] * torch.tensor([1.0, 0.0, 0.0])
    return start[:, None] + length * torch.linspace(0, 1, points)[None, :, None] * DOWN


def handedness(points: torch.Tensor) -> torch.Tensor:
    """Sign of the torsion of each strand: 1 for right-handed helices."""
    first = segments(points)
    second, third = first[:, 1:] - first[:, :-1], first[:, 2:] - 2 * first[:, 1:-1] + first[:, :-2]
    binormal = torch.linalg.cross(first[:, :-2], second[:, :-1])
    return (binormal * third).sum(dim=-1).sign().median(dim=1).values


@pytest.mark.parametrize("turn", [1, -1])
def test_wound_strands_are_helices(turn):
    axes, normals = straight(3, 0.2), torch.tensor([0.0, 0.0, 1.0]).expand(3, 3)
    angle = turn * 2 * math.pi * torch.linspace(0, 0.2, 400) / 0.025
    found = wound(axes, normals, torch.full((3, 400), 0.004), angle.expand(3, 400))
    offset = found - axes
    assert torch.allclose(offset.norm(dim=-1), torch.full((3, 400), 0.004), atol=1e-6)
    assert torch.allclose(offset[..., 1], torch.zeros(3, 400), atol=1e-6)
    expected = 0.2 * math.sqrt(1 + (2 * math.pi * 0.004 / 0.025) ** 2)
    assert torch.allclose(lengths(found), torch.full((3,), expected), rtol=2e-3)
    assert (handedness(found.double()) == turn).all()


def test_flat_waves_stay_in_a_plane():
    axes, normals = straight(2, 0.1), torch.tensor([0.0, 0.0, 1.0]).expand(2, 3)
    angle = 2 * math.pi * torch.linspace(0, 0.1, 400) / 0.02
    found = wound(axes, normals, torch.full((2, 400), 0.003), angle.expand(2, 400), roundness=0.0)
    assert torch.allclose(found[..., 2], torch.zeros(2, 400), atol=1e-6)
    assert (found - axes).norm(dim=-1).max() == pytest.approx(0.003, rel=1e-3)


def test_curls_start_at_the_root_and_have_points_enough():
    curl, normals = Curl(0.005, 0.02, 1), torch.tensor([0.0, 0.0, 1.0]).expand(4, 3)
    axes = straight(4, 0.24, points=100)
    found = curled(axes, normals, Locks(torch.linspace(0, 6, 4), torch.ones(4)), curl)
    assert torch.allclose(found[:, 0], axes[:, 0], atol=1e-6)
    assert found.shape[1] >= 12 * 12
    away = (found - found * torch.tensor([0.0, 1.0, 0.0]) - axes[:, :1]).norm(dim=-1)
    assert torch.allclose(away[:, -20:], torch.full((4, 20), 0.005), atol=1e-5)
    assert curl.slope == pytest.approx(math.tan(math.radians(57.52)), rel=1e-3)


def test_curls_without_a_side_turn_as_their_locks_do():
    axes, normals = straight(2, 0.1), torch.tensor([0.0, 0.0, 1.0]).expand(2, 3)
    locks = Locks(torch.zeros(2), torch.tensor([1.0, -1.0]))
    either = curled(axes, normals, locks, Curl(0.004, 0.02, 0, 0.5))
    for strand, turn in enumerate((1, -1)):
        assert torch.equal(either[strand], curled(axes, normals, locks, Curl(0.004, 0.02, turn, 0.5))[strand])
    deviation = (either - straight(2, 0.1, points=either.shape[1]))[:, -40:].abs().amax(dim=(0, 1))
    assert float(deviation[2]) == pytest.approx(0.5 * float(deviation[0]), rel=0.02)


def test_curls_keep_off_the_head():
    plane = torch.tensor([[-1.0, -1.0, -0.01], [1.0, -1.0, -0.01], [1.0, 1.0, -0.01], [-1.0, 1.0, -0.01]])
    box = torch.cat([plane, plane - torch.tensor([0.0, 0.0, 0.5])])
    faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 6], [2, 6, 3]]
    wall = Mesh(box, torch.tensor([*faces, [3, 6, 7], [3, 7, 0], [0, 7, 4]]))
    distance = SignedDistanceGrid.build(wall, 0.05, 0.1)
    axes, normals = straight(5, 0.2) - torch.tensor([0.0, 0.0, 0.008]), torch.tensor([0.0, 0.0, 1.0]).expand(5, 3)
    locks = Locks(torch.linspace(0, 2 * math.pi, 5), torch.ones(5))
    curl = Curl(0.006, 0.03, -1)
    assert (curled(axes, normals, locks, curl)[..., 2] < -0.0101).any()
    assert (curled(axes, normals, locks, curl, distance)[..., 2] > -0.0101).all()


@pytest.mark.parametrize("degrees", [-50.0, 0.0, 35.0])
def test_the_mean_lean_is_the_angle_by_which_directions_were_turned(degrees):
    random = torch.Generator().manual_seed(0)
    normals = torch.nn.functional.normalize(torch.randn(500, 3, generator=random), dim=-1)
    axes = torch.nn.functional.normalize(torch.linalg.cross(normals, torch.randn(500, 3, generator=random)), dim=-1)
    angle = math.radians(degrees)
    leaning = math.cos(angle) * axes + math.sin(angle) * torch.linalg.cross(normals, axes)
    # Neither the sign of a direction nor its part along the normal counts.
    sign = torch.where(torch.rand(500, 1, generator=random) < 0.5, -1.0, 1.0)
    found = mean_lean(sign * leaning + 0.3 * normals, axes, normals)
    assert math.degrees(found.angle) == pytest.approx(degrees, abs=1e-3)
    assert found.agreement == pytest.approx(1.0, abs=1e-5)


def test_directions_at_random_do_not_agree():
    random = torch.Generator().manual_seed(0)
    normals = torch.tensor([0.0, 0.0, 1.0]).expand(5000, 3)
    found = mean_lean(torch.randn(5000, 3, generator=random), DOWN.expand(5000, 3), normals)
    assert found.agreement < 0.05
    assert mean_lean(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 3)).agreement == 0


def cylinder() -> FlowField:
    """Hair that hangs in a vertical cylinder of 4 cm radius."""
    grid = VoxelGrid.filling((-0.06, -0.1, -0.06), (0.06, 0.1, 0.06), 0.002)
    nodes = grid.nodes()
    domain = nodes[..., [0, 2]].norm(dim=-1) < 0.04
    return FlowField(grid, DOWN.expand(*grid.shape, 3).contiguous(), domain)


def test_visible_tangents_of_curls_lean_and_turn_back_to_the_axes():
    """The outer sixth of the turns of right-handed helices about vertical axes, with arbitrary signs."""
    field, curl = cylinder(), Curl(0.005, 0.03, 1)
    around = torch.linspace(0, 2 * math.pi, 60)
    outward = torch.stack([around.cos(), torch.zeros(60), around.sin()], dim=1)
    axes = 0.034 * outward[:, None] + torch.linspace(0.08, -0.08, 800)[None, :, None] * -DOWN
    turns = 2 * math.pi * torch.linspace(0, 0.16, 800) / curl.pitch
    points = wound(axes, outward, torch.full((60, 800), curl.radius), turns.expand(60, 800))
    tangents = torch.nn.functional.normalize(segments(points), dim=-1)
    outer = ((points - axes)[:, :-1] * outward[:, None]).sum(dim=-1) > 0.87 * curl.radius
    tangents[::2] *= -1
    seen = LineSegments(
        points[:, :-1][outer],
        tangents[outer],
        torch.ones(int(outer.sum())),
        torch.zeros(int(outer.sum()), dtype=torch.int64),
    )
    lean = mean_lean(seen.directions, DOWN.expand(len(seen), 3), surface_normals(field.grid, field.domain, seen.points))
    assert math.degrees(lean.angle) == pytest.approx(-math.degrees(math.atan(curl.slope)), abs=3)
    back = turned_back(seen, field, lean.angle)
    error = torch.rad2deg(torch.arccos((back.directions @ DOWN).clamp(-1, 1)))
    # The rest of the error is the part of the tangents along the normal: sin(error) = sin(angle) sin(phase).
    assert error.median() < 12
    assert error.max() < 24


def test_locks_curl_in_phase():
    random = torch.Generator().manual_seed(0)
    roots = 0.1 * torch.rand(3000, 3, generator=random) * torch.tensor([1.0, 0.0, 1.0])
    locks, again = Locks.drawn(roots, 0.02), Locks.drawn(roots, 0.02)
    phase = locks.phase
    assert torch.equal(phase, again.phase)
    assert torch.equal(locks.turn, again.turn)
    assert 0.2 < (locks.turn > 0).float().mean() < 0.8
    assert all(len(locks.turn[phase == each].unique()) == 1 for each in phase.unique())
    assert (phase >= 0).all()
    assert (phase < 2 * math.pi).all()
    assert 10 < len(phase.unique()) < 100
    near = torch.cdist(roots, roots) < 0.002
    same = phase[:, None] == phase[None]
    assert same[near].float().mean() > 0.8
    far = torch.cdist(roots, roots) > 0.06
    assert not same[far].any()
