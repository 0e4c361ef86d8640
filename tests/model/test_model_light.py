"""Light through hair: against a walk from node to node, and what an edit does to it."""

import itertools
import math
from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.model.hair_volume import hair_volume
from neural_strands.model.light import (
    AMBIENT,
    BRIGHTEST,
    FADE,
    BakedLight,
    LightField,
    solid_voxels,
    surface_samples,
    transmitted,
)

NO_BODY = Mesh(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int64))
WIDTH = 1e-3


def walked(extinction, solid, spacing, node):
    """The mean over directions, one node after the other."""
    total, weights = 0.0, 0.0
    shape = extinction.shape
    for axis, sign, y, z in itertools.product(range(3), (1, -1), (-1, 0, 1), (-1, 0, 1)):
        step = [y, z]
        step.insert(axis, sign)
        length = math.sqrt(1 + y * y + z * z)
        weight = 0.5 ** (abs(y) + abs(z)) / length**3
        here, light = list(node), math.exp(-0.5 * spacing * length * float(extinction[tuple(node)]))
        while True:
            here = [place - way for place, way in zip(here, step, strict=True)]
            if not all(0 <= place < size for place, size in zip(here, shape, strict=True)):
                break
            light *= 0.0 if solid[tuple(here)] else math.exp(-spacing * length * float(extinction[tuple(here)]))
        total, weights = total + weight * light, weights + weight
    return total / weights


def ball(count=400, radius=0.03, seed=0):
    """Strands that stand on a ball, and places on a chart."""
    random = torch.Generator().manual_seed(seed)
    out = torch.nn.functional.normalize(torch.randn(count, 3, generator=random), dim=1)
    along = torch.linspace(1.0, 2.0, 25)
    points = radius * out[:, None] * along[:, None]
    return Strands(points, root_uv=torch.rand(count, 2, generator=random))


def baked(strands, body=NO_BODY):
    return BakedLight.of(strands, hair_volume(strands.points), WIDTH, body, torch.ones_like(body.vertices))


def test_light_is_what_a_walk_through_the_grid_finds():
    random = torch.Generator().manual_seed(0)
    extinction = 200 * torch.rand(4, 5, 3, generator=random)
    solid = (torch.rand(4, 5, 3, generator=random) < 0.2).float()
    found = transmitted(extinction, solid, 0.005)
    for node in itertools.product(range(4), range(5), range(3)):
        assert float(found[node]) == pytest.approx(walked(extinction, solid, 0.005, node), abs=1e-5)


def test_all_light_reaches_a_place_without_hair():
    assert torch.allclose(transmitted(torch.zeros(3, 4, 5), torch.zeros(3, 4, 5), 0.01), torch.ones(3, 4, 5))


def test_the_middle_of_a_ball_of_hair_is_darker_than_its_rim():
    strands = ball()
    field = LightField.through(hair_volume(strands.points), WIDTH, torch.zeros(0, 3))
    middle, rim, away = field.at(torch.tensor([[0.0, 0.0, 0.0], [0.06, 0.0, 0.0], [0.3, 0.0, 0.0]])).tolist()
    assert AMBIENT < middle < rim < away
    assert away > 0.95


def test_a_triangle_larger_than_voxels_blocks_all_that_it_crosses():
    grid = VoxelGrid.filling((0.0, 0.0, 0.0), (0.1, 0.1, 0.1), 0.01)
    wall = Mesh(torch.tensor([[-0.5, -0.5, 0.055], [1.0, -0.5, 0.055], [-0.5, 1.0, 0.055]]), torch.tensor([[0, 1, 2]]))
    solid = solid_voxels(grid, surface_samples(wall, grid.spacing))
    assert bool((solid[:4, :4, 5] == 1).all())
    assert float(solid[:, :, :5].sum()) == float(solid[:, :, 6:].sum()) == 0


def test_hair_that_stays_is_lit_as_it_was():
    strands = ball()
    same = baked(strands).changed(replace(strands, points=strands.points.clone()), hair_volume(strands.points))
    assert torch.allclose(same.strands, torch.ones(400, 12, 1), atol=1e-5)


def test_hair_that_is_thinned_or_cut_and_the_skin_beneath_are_lit_more():
    corners = torch.tensor([[0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.03]])
    strands = ball()
    light, lattice = baked(strands, Mesh(corners, torch.tensor([[0, 1, 2]]))), hair_volume(strands.points).grid
    thin = strands.select(torch.arange(100))
    found = light.changed(thin, hair_volume(thin.points, lattice))
    assert float(found.strands.min()) > 1.0
    assert bool(((found.skin.factor > 1.0) & (found.skin.factor <= BRIGHTEST)).all())
    # Half of every strand is left; t tells on which half its appearance was learned.
    half = replace(strands, points=strands.points[:, :13], t=strands.parameters()[:, :13])
    cut = light.changed(half, hair_volume(half.points, lattice))
    assert float(cut.strands.min()) > 1.0


def curtain():
    """A neck behind hair that hangs, and the same hair cut above it."""
    heights = torch.linspace(0, -0.2, 9)
    neck = torch.stack([torch.full((9,), 0.01), heights, torch.zeros(9)], dim=1)
    faces = torch.tensor([[k, k + 1, (k + 4) % 9] for k in range(8)])
    random = torch.Generator().manual_seed(1)
    roots = 0.06 * torch.rand(300, 3, generator=random) * torch.tensor([1.0, 0.3, 1.0])
    fall = torch.linspace(0, -0.2, 25)[None, :, None] * torch.tensor([0.0, 1.0, 0.0])
    strands = Strands(roots[:, None] + fall, root_uv=torch.rand(300, 2, generator=random))
    cut = replace(strands, points=strands.points[:, :5], t=strands.parameters()[:, :5])
    return Mesh(neck, faces), strands, cut


def test_skin_below_hair_that_is_cut_off_is_never_darker_than_before():
    """The cut hair ends higher than the neck, whose light must not be read at the border of a smaller grid."""
    neck, strands, cut = curtain()
    found = baked(strands, neck).changed(cut, hair_volume(cut.points, hair_volume(strands.points).grid))
    assert float(found.skin.factor.min()) > 0.999
    assert float(found.skin.factor.max()) > 1.1


def test_skin_that_hair_hid_takes_the_colour_of_the_skin_around_it():
    neck, strands, cut = curtain()
    # The neck continues below the hair, in another colour; behind hair, any colour may have been learned.
    bare = Mesh(torch.cat([neck.vertices, neck.vertices[-1:] + torch.tensor([[0.0, -0.3, 0.0]])]), neck.faces)
    bare = replace(bare, faces=torch.cat([bare.faces, torch.tensor([[7, 8, 9]])]))
    volume = hair_volume(strands.points)
    skin = torch.rand(10, 3, generator=torch.Generator().manual_seed(3))
    light = BakedLight.of(strands, volume, 30 * WIDTH, bare, skin)
    found = light.changed(cut, hair_volume(cut.points, volume.grid)).skin
    hidden = found.share > 0.99
    assert int(hidden.sum()) >= 4
    assert float(found.share[9]) == 0.0
    colours = torch.nn.functional.normalize(found.instead[hidden], dim=1)
    known = torch.nn.functional.normalize(light.bare[light.known > 0.01], dim=1)
    # Each colour lies between the known ones, except for the amount of light.
    assert float((colours @ known.T).amax(dim=1).min()) > 0.98
    # More light reaches the skin that the cut has exposed.
    assert float(found.instead[8].sum()) > float((light.bare[8] * light.skin[8]).sum())


def test_light_needs_to_know_which_strand_is_which():
    strands = ball(10)
    with pytest.raises(ValueError, match="root_uv"):
        baked(replace(strands, root_uv=None))
    with pytest.raises(ValueError, match="root_uv"):
        baked(strands).changed(replace(strands, root_uv=None), hair_volume(strands.points))


def test_the_light_on_skin_changes_gradually_towards_the_border_of_the_grid():
    """There, light enters the fitted hair's grid that a larger one may find blocked."""
    strands = ball()
    volume = hair_volume(strands.points)
    low = volume.grid.origin[1] - 0.5 * volume.grid.spacing
    heights = low + torch.tensor([-0.01, 0.001, 0.5 * FADE, FADE + 0.001])
    places = torch.stack([torch.full((4,), 0.05), heights, torch.zeros(4)], dim=1)
    light = baked(strands, Mesh(places, torch.tensor([[0, 1, 2], [1, 2, 3]])))
    shaved = strands.select(torch.arange(20))
    after = hair_volume(shaved.points, volume.grid)
    whole = LightField.through(after, WIDTH, light.surface).at(light.skin_places) / light.skin
    depth = volume.grid.depth(light.skin_places) / FADE
    found = light.changed(shaved, after).skin.factor
    assert float(found[0]) == 1.0
    assert 0.0 < float(depth[1]) < 0.2
    assert 0.3 < float(depth[2]) < 0.7
    assert float(whole[3]) > 1.02
    torch.testing.assert_close(found[1:], 1 + depth[1:].clamp(max=1.0) * (whole[1:] - 1))
