"""Fusion against plain numpy: votes of other views, and gaps filled by the best guess."""

import math

import numpy as np
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.lmvs.consistency import LineCloud, confirmations, line_points
from neural_strands.lmvs.fusion import add_guesses, best_share, fill_gaps, share_reached
from neural_strands.lmvs.patchmatch import LineMap
from neural_strands.lmvs.search_range import SmoothHull


def camera(x: float, name: str = "") -> Camera:
    return Camera.look_at(torch.tensor([x, 0.1, 1.0]), torch.zeros(3), 90.0, (60, 48), name)


def lines_of(view: Camera, depth: float, turn: float, generator: torch.Generator) -> LineMap:
    """A line at every second pixel, about `depth` away and about along x."""
    row, column = torch.meshgrid(torch.arange(0, 48, 2), torch.arange(0, 60, 2), indexing="ij")
    pixel = torch.stack([column, row], dim=-1).reshape(-1, 2)
    count = len(pixel)
    angle = turn * (2 * torch.rand(count, generator=generator) - 1)
    line = torch.stack([torch.cos(angle), torch.sin(angle), torch.zeros(count)], dim=-1)
    line = line * torch.sign(torch.randn(count, 1, generator=generator))
    away = depth + 0.01 * torch.randn(count, generator=generator)
    return LineMap(pixel, away, line, torch.zeros(count))


def test_votes_are_those_of_a_loop(generator: torch.Generator):
    views = [camera(x) for x in (-0.1, 0.0, 0.1)]
    maps = [lines_of(view, 1.0, 0.6, generator) for view in views]
    distance, angle = 0.03, math.radians(30)
    points = line_points(views[0], maps[0])
    given = list(zip(views[1:], maps[1:], strict=True))
    found = confirmations(points, maps[0].direction, given, distance, angle, 2)
    others = [{tuple(p): k for k, p in enumerate((m.pixel // 2).tolist())} for m in maps[1:]]
    voted = 0
    for i in range(0, len(points), 7):
        point, line = points[i].double().numpy(), maps[0].direction[i].double().numpy()
        votes = 0.0
        for view, lines, index in zip(views[1:], maps[1:], others, strict=True):
            seen, _ = view.project(points[i : i + 1])
            cell = tuple(torch.div(seen[0].floor(), 2, rounding_mode="floor").long().tolist())
            if cell not in index or not (0 <= seen[0, 0] < 60 and 0 <= seen[0, 1] < 48):
                continue
            k = index[cell]
            other = line_points(view, lines)[k].double().numpy()
            way = lines.direction[k].double().numpy()
            off = math.acos(min(abs(way @ line), 1.0))
            gap = np.linalg.norm(other - point)
            if gap >= distance or off >= angle:
                continue
            votes += math.sqrt(1 - gap / distance) * (1 - off / angle)
        voted += votes > 0
        assert abs(float(found[i]) - votes) < 2e-3
    assert voted > 20


def cloud(points: list[list[float]], weight: list[float]) -> LineCloud:
    count = len(points)
    lines = torch.tensor([[1.0, 0.0, 0.0]]).repeat(count, 1)
    return LineCloud(torch.tensor(points), lines, torch.tensor(weight), torch.zeros(count, dtype=torch.int64))


def test_gaps_take_the_best_guess_of_each_empty_cell():
    confirmed = cloud([[0.5, 0.5, 0.5]], [0.1])
    guesses = cloud(
        [[0.2, 0.2, 0.2], [1.2, 0.5, 0.5], [1.8, 0.5, 0.5], [-0.5, 0.5, 0.5], [-0.4, 0.5, 0.5], [9.0, 9.0, 9.0]],
        [0.9, 0.3, 0.6, 0.2, 0.2, 0.0],
    )
    found = fill_gaps(guesses, confirmed, 1.0)
    assert sorted(round(float(x), 3) for x in found.points[:, 0]) == [-0.5, 1.8, 9.0]


def test_fusion_of_nothing_is_nothing():
    empty = cloud([[0.0, 0.0, 0.0]], [1.0]).select(torch.zeros(1, dtype=torch.bool))
    assert len(fill_gaps(empty, empty, 1.0).points) == 0


def test_guesses_become_short_segments_after_the_others():
    ids = torch.tensor([0, 0, 0])
    chain = LineSegments(torch.zeros(3, 3), torch.tensor([[0.0, 1.0, 0.0]]).repeat(3, 1), torch.ones(3), ids)
    joined = add_guesses(chain, cloud([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [0.5, 0.5]), 0.2)
    assert joined.segment_id.tolist() == [0, 0, 0, 1, 1, 2, 2]
    assert torch.allclose(joined.points[3:, 0], torch.tensor([0.9, 1.1, 1.9, 2.1]))
    assert (joined.confidence[3:] < 0.2).all()


def test_the_worst_guesses_are_dropped():
    kept = best_share(cloud([[float(k), 0.0, 0.0] for k in range(5)], [0.3, 0.9, 0.1, 0.3, 0.5]), 0.6)
    assert kept.points[:, 0].tolist() == [1.0, 4.0, 0.0]
    assert len(best_share(kept, 0.0).points) == 0


def test_the_share_of_a_slab_that_one_plane_of_points_reaches(generator: torch.Generator):
    space = torch.rand(50_000, 3, generator=generator)
    plane = torch.stack(torch.meshgrid(*[torch.linspace(0, 1, 80)] * 2, indexing="ij"), dim=-1).reshape(-1, 2)
    middle = torch.cat([torch.full((len(plane), 1), 0.5), plane], dim=1)
    assert abs(share_reached(space, middle, 0.2) - 0.4) < 0.015
    assert share_reached(space, middle, 0.6) == 1.0
    assert share_reached(space, middle[:0], 0.2) == 0.0
    # Nothing to fill: all of it is reached.
    assert share_reached(space[:0], middle, 0.2) == 1.0


def test_nodes_of_a_hull_are_those_inside_in_a_fixed_order():
    grid = torch.zeros(6, 5, 4)
    grid[1:3, 2, 1:4] = 0.7
    hull = SmoothHull(VoxelGrid((1.0, 2.0, 3.0), 0.5, (6, 5, 4)), grid)
    found = hull.nodes()
    expected = {(1 + 0.5 * x, 3.0, 3 + 0.5 * z) for x in (1, 2) for z in (1, 2, 3)}
    assert len(found) == 6
    assert {tuple(point) for point in found.tolist()} == expected
    assert torch.equal(found, hull.nodes())
