"""Hair that no view sees, extrapolated over a ball, against closed forms."""

import math

import pytest
import torch
import trimesh

from neural_strands.flow.unseen import (
    HELD,
    OverHead,
    UnseenConfig,
    along_head,
    bare_skin,
    climbing,
    guess_unseen,
    hair_extent,
    hanging,
    harmonic,
    head_layer,
    unseen_points,
)
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.visual_hull import HeadView
from neural_strands.geometry.voxel_grid import VoxelGrid

RADIUS, THICK = 0.09, 0.015
GRID = VoxelGrid.filling((-0.14, -0.14, -0.14), (0.14, 0.14, 0.14), 0.004)


@pytest.fixture(scope="module")
def ball() -> Mesh:
    sphere = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    return Mesh(torch.tensor(sphere.vertices).float(), torch.tensor(sphere.faces).long())


@pytest.fixture(scope="module")
def front(ball: Mesh) -> list[HeadView]:
    """Views of the ball from azimuths up to 60 degrees to each side."""
    index = MeshIndex(ball)
    eyes = [(math.sin(a), 0.3, math.cos(a)) for a in torch.linspace(-math.pi / 3, math.pi / 3, 5).tolist()]
    return [HeadView.of(Camera.look_at(torch.tensor(eye), torch.zeros(3), 200.0, (96, 96)), index) for eye in eyes]


def shell() -> torch.Tensor:
    """Voxels of hair THICK over the ball, and everything right behind it, which the ball hides."""
    nodes = GRID.nodes()
    distance = nodes.norm(dim=-1) - RADIUS
    hidden = (nodes[..., 2] < 0) & (nodes[..., :2].norm(dim=-1) < 0.06)
    return (distance > -0.004) & ((distance < THICK) | hidden)


def combed(generator: torch.Generator) -> LineSegments:
    """Points on the shell's front, running down the meridians."""
    outward = torch.nn.functional.normalize(torch.randn(20000, 3, generator=generator), dim=-1)
    outward = outward[(outward[:, 2] > -0.3) & (outward[:, 1].abs() < 0.95)]
    down = torch.tensor([0.0, -1.0, 0.0])
    along = torch.nn.functional.normalize(down - (outward @ down)[:, None] * outward, dim=-1)
    return LineSegments((RADIUS + THICK) * outward, along, torch.ones(len(outward)), torch.arange(len(outward)))


def test_what_the_ball_hides_or_shows_from_the_far_side_is_unseen(ball: Mesh, front: list[HeadView]):
    angle = torch.deg2rad(torch.tensor([0.0, 60.0, 100.0, 170.0, 180.0]))
    outward = torch.stack([angle.sin(), torch.zeros(5), angle.cos()], dim=-1)
    for distance in (0.0, 0.01, 0.04):
        points = (RADIUS + distance) * outward
        found = unseen_points(points, torch.full((5,), distance), outward, front)
        assert found.tolist() == [False, False, False, True, True]


def test_harmonic_values_between_two_planes_are_linear():
    known, fixed = torch.zeros(9, 3, 3, 1), torch.zeros(9, 3, 3, dtype=torch.bool)
    fixed[0], fixed[-1], known[-1] = True, True, 8.0
    found = harmonic(known, fixed, torch.ones_like(fixed), 500)
    torch.testing.assert_close(found[:, 1, 1, 0], torch.arange(9.0), atol=1e-3, rtol=0)


def test_directions_keep_to_the_head_and_hair_may_fall_from_an_overhang():
    up, side, down = torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    leaning = torch.nn.functional.normalize(torch.tensor([1.0, 0.0, 1.0]), dim=0)
    given = torch.stack([down, up + leaning, -side, leaning, down])
    outward = torch.stack([up, up, side, side, down])
    expected = torch.stack([0 * up, leaning, 0 * up, torch.tensor([0.5**0.5, 0.0, 0.0]), down])

    def laid(distance: float, rise: float = 0.0) -> torch.Tensor:
        return along_head(given, OverHead(outward, torch.full((5,), distance), torch.full((5,), rise)))

    torch.testing.assert_close(laid(0.02), expected)
    # Clear of the head, hair runs as it likes; in between, by half.
    torch.testing.assert_close(laid(0.06), given)
    torch.testing.assert_close(laid(0.0375), 0.5 * (given + expected))
    # Where hair climbs, it does so at least at this slope.
    slope = (laid(0.02, 0.3) * outward).sum(dim=-1)
    torch.testing.assert_close(slope, torch.maximum((expected * outward).sum(dim=-1), 0.3 * given.norm(dim=-1)))


def test_hair_climbs_to_its_surface_and_never_steeply():
    thickness, distance = torch.tensor([0.012, 0.012, 0.012, 0.08]), torch.tensor([0.0, 0.008, 0.02, 0.0])
    expected = torch.tensor([0.3, 0.1, 0.0, 0.35])
    torch.testing.assert_close(climbing(thickness, distance, UnseenConfig(climb=0.04, steepest=0.35)), expected)


def test_hair_hangs_from_its_lowest_voxel():
    hair = torch.zeros(2, 4, 1, dtype=torch.bool)
    hair[0, 2, 0] = True
    assert hanging(hair)[:, :, 0].tolist() == [[True, True, True, False], [False] * 4]


def test_hair_behind_is_as_thick_as_what_is_seen(ball: Mesh, front: list[HeadView]):
    layer = head_layer(GRID, front, ball, UnseenConfig())
    thickness, haired = hair_extent(layer, GRID, shell(), torch.zeros(0, 3), 300).unbind(dim=-1)
    nodes = layer.grid.nodes()
    behind = (nodes[..., 2] < -0.085) & ((nodes.norm(dim=-1) - RADIUS - THICK).abs() < 0.008)
    assert behind.any()
    assert (layer.unseen[behind] > 0).float().mean() > 0.5
    assert ((thickness[behind] - THICK).abs() < 0.004).all()
    assert (haired[behind] > 0.99).all()


def test_bare_skin_ends_the_hair_that_is_continued(ball: Mesh, front: list[HeadView]):
    layer = head_layer(GRID, front, ball, UnseenConfig())
    domain = shell() & ~((GRID.nodes()[..., 1] < 0) & (GRID.nodes()[..., 2] > -0.06))
    bare = bare_skin(layer, GRID, domain, ball)
    assert (bare[:, 1] < 0.01).all()
    thickness, haired = hair_extent(layer, GRID, domain, bare, 300).unbind(dim=-1)
    nodes = layer.grid.nodes()
    near = (nodes.norm(dim=-1) - RADIUS - 0.006).abs() < 0.006
    low, high = (near & (nodes[..., 2] < -0.02) & (sign * nodes[..., 1] > 0.04) for sign in (-1, 1))
    # Half of the rim about what is unseen is bare below, none of it above; what hair there is, is as thick.
    assert haired[low].mean() < 0.45
    assert haired[high].mean() > 0.85
    assert ((thickness[low | high] - THICK).abs() < 0.004).all()


def test_unseen_hair_lies_down_within_a_shell(ball: Mesh, front: list[HeadView], generator: torch.Generator):
    layer = head_layer(GRID, front, ball, UnseenConfig())
    domain, guess = guess_unseen(layer, GRID, shell(), combed(generator), ball, masked=True)
    places = GRID.nodes().reshape(-1, 3)[guess.voxels]
    assert len(places) > 100
    assert domain.reshape(-1)[guess.voxels].all()
    # No space is left behind the shell.
    left = GRID.nodes()[domain]
    assert (left[:, ::2].norm(dim=-1) < RADIUS + THICK + 0.006).all()
    assert (left.norm(dim=-1) < RADIUS + THICK + 0.006)[left[:, 1] > 0].all()
    outward = torch.nn.functional.normalize(places, dim=-1)
    direction = torch.nn.functional.normalize(guess.directions, dim=-1)
    middle = outward[:, 1].abs() < 0.6
    # Along the head but for its climb to the hair's surface; from the head's underside hair may fall freely.
    down = torch.tensor([0.0, -1.0, 0.0])
    rise, falling = (direction * outward).sum(dim=-1), (outward @ down).clamp(min=0)
    distance = places.norm(dim=-1) - RADIUS
    climb = climbing(torch.full_like(distance, THICK), distance, UnseenConfig())
    held = distance < HELD
    assert ((rise > -0.15) & (rise < torch.maximum(falling, climb) + 0.15))[held].float().mean() > 0.95
    meridian = torch.nn.functional.normalize(down - (outward @ down)[:, None] * outward, dim=-1)
    along = torch.nn.functional.normalize(direction - rise[:, None] * outward, dim=-1)
    assert ((along * meridian).sum(dim=-1)[middle & held] > 0.9).float().mean() > 0.95


def test_without_masks_the_unseen_part_is_added(ball: Mesh, front: list[HeadView], generator: torch.Generator):
    layer = head_layer(GRID, front, ball, UnseenConfig())
    nodes = GRID.nodes()
    distance = nodes.norm(dim=-1) - RADIUS
    covered = (distance > -0.004) & (distance < THICK) & (nodes[..., 2] > -0.03)
    domain, guess = guess_unseen(layer, GRID, covered, combed(generator), ball, masked=False)
    assert (domain | ~covered).all()
    behind = (distance > 0.002) & (distance < 0.5 * THICK) & (nodes[..., 2] < -0.085)
    assert domain[behind].float().mean() > 0.95
    assert not domain[distance > THICK + 0.008].any()
    assert len(guess.voxels)


def test_a_ball_seen_from_all_sides_has_nothing_to_guess(ball: Mesh, generator: torch.Generator):
    index = MeshIndex(ball)
    around = torch.nn.functional.normalize(torch.randn(60, 3, generator=generator), dim=-1)
    views = [HeadView.of(Camera.look_at(eye, torch.zeros(3), 200.0, (96, 96)), index) for eye in around]
    layer = head_layer(GRID, views, ball, UnseenConfig())
    outside = layer.distance > 0
    assert not layer.unseen[outside].any()
    kept, guess = guess_unseen(
        layer, GRID, shell() & (GRID.nodes().norm(dim=-1) > RADIUS + 0.005), combed(generator), ball, True
    )
    assert len(guess.voxels) == 0
    assert kept.any()
