"""Haircuts, against what a walk along each polyline finds."""

import itertools
import math
from dataclasses import replace

import pytest
import torch
import trimesh
from tiny_hair import tiny_hair_model

from neural_strands.editing.hair import Hair
from neural_strands.editing.haircut import arc_lengths, cut_hair, ragged, shortened
from neural_strands.editing.settings import SHORTEST, Haircut
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands, lengths, segments


def walk(points: list[list[float]], outside, step: float = 2e-5) -> float:
    """Arc length at which a polyline first leaves a shape, by small steps; its whole length where it stays inside."""
    gone = 0.0
    for start, end in itertools.pairwise(points):
        size = math.dist(start, end)
        for k in range(max(1, math.ceil(size / step))):
            share = k / max(1, math.ceil(size / step))
            if outside([a + share * (b - a) for a, b in zip(start, end, strict=True)]):
                return gone + share * size
        gone += size
    return gone


@pytest.fixture(scope="module")
def strands() -> Strands:
    return Hair.of(tiny_hair_model()).strands


def test_length(strands):
    cut = cut_hair(Haircut(length=0.05, uneven=0.0), strands)
    expected = lengths(strands.points).clamp(max=0.05)
    assert torch.allclose(lengths(cut.points), expected, atol=5e-4)
    assert (lengths(cut.points) <= 0.05 + 1e-6).all()
    assert torch.equal(cut.points[:, 0], strands.points[:, 0])


def test_fraction_keeps_that_share_of_every_strand(strands):
    cut = cut_hair(Haircut(fraction=0.25, uneven=0.0), strands)
    straight = Strands(torch.linspace(0, 1, 5)[None, :, None] * torch.tensor([0.1, 0.0, 0.0]))
    assert torch.allclose(lengths(cut.points), 0.75 * lengths(strands.points), rtol=0.02)
    assert torch.allclose(cut_hair(Haircut(fraction=0.25, uneven=0.0), straight).points[0, -1, 0], torch.tensor(0.075))


def beyond_the_plane(point):
    return 0.3 * point[0] + point[1] - 0.1 > 0


def outside_the_box(point):
    return not (-0.1 <= point[0] <= 0.2 and -0.02 <= point[1] <= 0.2 and -0.12 <= point[2] <= 0.12)


def outside_the_ball(point):
    # The ball's faces lie up to 0.3 mm inside the sphere.
    return math.hypot(*point) > 0.1099


@pytest.mark.parametrize("way", ["plane", "box", "mesh"])
def test_shapes_cut_where_a_walk_leaves_them(strands, way, tmp_path):
    some = strands.select(torch.arange(0, 200, 10))
    if way == "plane":
        haircut = Haircut(plane=(0.0, 0.1, 0.0, 0.3, 1.0, 0.0), uneven=0.0)
        outside = beyond_the_plane
    elif way == "box":
        haircut = Haircut(box=(0.2, 0.2, 0.12, -0.1, -0.02, -0.12), uneven=0.0)
        outside = outside_the_box
    else:
        ball = trimesh.creation.icosphere(subdivisions=3, radius=0.11)
        ball.export(tmp_path / "ball.ply")
        haircut = Haircut(mesh=str(tmp_path / "ball.ply"), uneven=0.0)
        outside = outside_the_ball

    expected = torch.tensor([walk(each, outside) for each in some.points.tolist()])
    cut = cut_hair(haircut, some)
    remain = expected >= torch.minimum(lengths(some.points), torch.tensor(SHORTEST))
    assert len(cut) == int(remain.sum())
    # The first crossing within a segment is exact for planes; elsewhere the distance is not linear along it.
    assert torch.allclose(lengths(cut.points), expected[remain], atol=2e-3)
    tips = cut.points[:, -1][expected[remain] < lengths(some.points)[remain] - 1e-4]
    assert len(tips)


def test_what_remains_knows_its_place_and_its_width(strands):
    assert strands.width is not None
    cut = cut_hair(Haircut(fraction=0.5, uneven=0.0), strands)
    assert cut.t is not None
    assert cut.width is not None
    arc, share = arc_lengths(strands.points), cut.parameters()
    # The place of t = 0.3 lies on the strand as it was, at its own share of the points.
    for k in (3, 11, 19):
        place = share[:, k] * (strands.points_per_strand - 1)
        low = place.long().clamp(max=strands.points_per_strand - 2)
        weight = (place - low)[:, None]
        row = torch.arange(len(strands))
        on_strand = torch.lerp(strands.points[row, low], strands.points[row, low + 1], weight)
        assert torch.allclose(cut.points[:, k], on_strand, atol=1e-6)
        assert torch.allclose(share[:, k], share[:, -1] * k / (strands.points_per_strand - 1), atol=1e-6)
    assert torch.allclose(arc, torch.nn.functional.pad(segments(strands.points).norm(dim=-1).cumsum(dim=1), (1, 0)))
    # A tip tapers over its last tenth, which is gone: the cut end is as thick as the rest.
    assert (strands.width[:, -1] == 0).all()
    assert torch.allclose(cut.width, torch.full_like(cut.width, 1e-4))


def test_cutting_nothing_changes_nothing(strands):
    cut = shortened(strands, torch.full((len(strands),), 10.0))
    assert torch.allclose(cut.points, strands.points, atol=1e-7)
    assert torch.allclose(cut.parameters(), strands.parameters(), atol=1e-6)


def test_uneven_edge_is_seeded_and_within_bounds(strands):
    def tips(seed):
        return lengths(cut_hair(Haircut(length=0.04, uneven=0.01, seed=seed), strands).points)

    assert torch.equal(tips(1), tips(1))
    assert not torch.equal(tips(1), tips(2))
    long = lengths(strands.points) > 0.05
    assert (tips(1)[long] <= 0.0401).all()
    assert (tips(1)[long] >= 0.0295).all()
    assert tips(1)[long].std() > 1e-3
    varied = ragged(strands.points[:, 0], 0)
    assert 0 <= varied.min() < 0.35
    assert 0.65 < varied.max() <= 1


def test_a_painted_region_is_cut_and_the_rest_is_not(strands):
    assert strands.root_uv is not None
    cut = cut_hair(Haircut(length=0.02, uneven=0.0, region=((0.25, 0.5, 0.2),)), strands)
    away = (strands.root_uv - torch.tensor([0.25, 0.5])).norm(dim=1)
    assert torch.equal(cut.points[away > 0.2].isfinite().all(), torch.tensor(True))
    assert torch.allclose(cut.points[away > 0.2], strands.points[away > 0.2], atol=1e-6)
    assert (lengths(cut.points[away < 0.1]) <= 0.0201).all()


def test_refusals(strands):
    with pytest.raises(InputError, match="plane cuts off all 200 strands; move"):
        cut_hair(Haircut(plane=(0.0, 1.0, 0.0, 0.0, -1.0, 0.0)), strands)
    with pytest.raises(InputError, match="fraction cuts off all 200 strands; give a smaller one"):
        cut_hair(Haircut(fraction=1.0), strands)
    with pytest.raises(InputError, match="found none in it; paint where roots are"):
        cut_hair(Haircut(length=0.1, region=((3.0, 3.0, 0.1),)), strands)
    with pytest.raises(InputError, match="expected strands with root_uv for a painted region"):
        cut_hair(Haircut(length=0.1, region=((0.5, 0.5, 0.1),)), replace(strands, root_uv=None))
    with pytest.raises(InputError, match="expected one of length, fraction, plane, box, mesh, found length and fracti"):
        Haircut(length=0.1, fraction=0.5)
    with pytest.raises(InputError, match="found none; give one"):
        Haircut()
    with pytest.raises(InputError, match="normal with a length"):
        Haircut(plane=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0))


def test_a_groom_without_root_uv_can_be_cut(strands):
    bare = Strands(strands.points)
    cut = cut_hair(Haircut(length=0.03, uneven=0.0), bare)
    assert (lengths(cut.points) < 0.0301).all()
    assert cut.root_uv is None
