"""Nearest neighbours within a radius, and matches within a distance and an angle, for millions of points.

Each search has a plain torch version with the same signature (`*_reference`), quadratic and slow, for tests.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import torch
import warp as wp
from jaxtyping import Float, Int32, Int64
from scipy.spatial import KDTree
from torch import Tensor

from neural_strands.foundation.kernels import array, launch_split
from neural_strands.geometry.kernels.point_queries import MOST_LEVELS, LevelVector, levels_kernel, nearest_kernel
from neural_strands.geometry.point_grid import PointGrid

TWIN_CHUNK = 256
"""Number of queries that the quadratic versions compare with all points in one block."""


def nearest(
    queries: Float[Tensor, "query 3"], points: Float[Tensor, "point 3"] | PointGrid, radius: float
) -> tuple[Float[Tensor, " query"], Int64[Tensor, " query"]]:
    """Distance to and index of the point nearest to each query, within `radius` metres.

    The result is not differentiable; gather the points by index to differentiate the distance. Of equally near points
    the one with the lowest index is returned. Queries that are not finite have no neighbour.

    Args:
        queries: positions, metres.
        points: positions, metres, or a grid of them when several searches share it.
        radius: farthest distance that counts, metres.

    Returns:
        The distances in metres, infinite if no point is within the radius; and the indices, then -1.
    """
    grid = points if isinstance(points, PointGrid) else PointGrid.build(points, radius)
    distance = torch.full((len(queries),), math.inf, device=queries.device)
    index = torch.full((len(queries),), -1, dtype=torch.int32, device=queries.device)
    if len(grid) and len(queries):
        found = [array(grid.order), array(queries.float(), wp.vec3), radius, array(distance), array(index)]
        launch_split(nearest_kernel, len(queries), [*grid.kernel_inputs(), *found], queries.device)
    return distance, index.long()


def nearest_reference(
    queries: Float[Tensor, "query 3"], points: Float[Tensor, "point 3"], radius: float
) -> tuple[Float[Tensor, " query"], Int64[Tensor, " query"]]:
    """`nearest` by brute force: every query against every point."""
    distance = torch.full((len(queries),), math.inf, device=queries.device)
    index = torch.full((len(queries),), -1, dtype=torch.int64, device=queries.device)
    if len(points) == 0:
        return distance, index
    for start in range(0, len(queries), TWIN_CHUNK):
        chunk = slice(start, start + TWIN_CHUNK)
        smallest, best = (queries[chunk, None] - points).norm(dim=-1).min(dim=1)
        near = smallest <= radius
        distance[chunk] = torch.where(near, smallest, distance[chunk])
        index[chunk] = torch.where(near, best, index[chunk])
    return distance, index


def match_levels(
    queries: Float[Tensor, "query 3"],
    query_directions: Float[Tensor, "query 3"],
    points: Float[Tensor, "point 3"] | PointGrid,
    point_directions: Float[Tensor, "point 3"],
    thresholds: Sequence[tuple[float, float]],
) -> tuple[Int32[Tensor, " query"], Int32[Tensor, " query"]]:
    """The strictest threshold at which each query has a match: a near point whose direction deviates little.

    Args:
        queries: positions, metres.
        query_directions: unit vectors.
        points: positions, metres, or a grid of them.
        point_directions: unit vectors, in the order of the points that a grid was built from.
        thresholds: (radius in metres, largest angle in radians) from strict to lax; neither may decrease.

    Returns:
        Two indices per query, `len(thresholds)` if nothing matches: with unsigned and with signed directions.

    Raises:
        ValueError: the thresholds do not grow, or there are more than eight.
    """
    check_thresholds(thresholds)
    grid = points if isinstance(points, PointGrid) else PointGrid.build(points, thresholds[-1][0])
    count = len(thresholds)
    unsigned = torch.full((len(queries),), count, dtype=torch.int32, device=queries.device)
    signed = unsigned.clone()
    if len(grid) and len(queries):
        padding = [0.0] * (MOST_LEVELS - count)
        inputs = [
            *grid.kernel_inputs(),
            array(grid.sorted_values(point_directions.float()), wp.vec3),
            array(queries.float(), wp.vec3),
            array(query_directions.float(), wp.vec3),
            LevelVector(*[radius for radius, _ in thresholds], *padding),
            LevelVector(*[math.cos(angle) for _, angle in thresholds], *padding),
            count,
            array(unsigned),
            array(signed),
        ]
        launch_split(levels_kernel, len(queries), inputs, queries.device)
    return unsigned, signed


def match_levels_reference(
    queries: Float[Tensor, "query 3"],
    query_directions: Float[Tensor, "query 3"],
    points: Float[Tensor, "point 3"],
    point_directions: Float[Tensor, "point 3"],
    thresholds: Sequence[tuple[float, float]],
) -> tuple[Int32[Tensor, " query"], Int32[Tensor, " query"]]:
    """`match_levels` by brute force: every query against every point."""
    check_thresholds(thresholds)
    levels = [torch.full((len(queries),), len(thresholds), dtype=torch.int32, device=queries.device) for _ in range(2)]
    for start in range(0, len(queries), TWIN_CHUNK):
        chunk = slice(start, start + TWIN_CHUNK)
        distance = (queries[chunk, None] - points).norm(dim=-1)
        cosine = query_directions[chunk] @ point_directions.T
        for level, (radius, angle) in reversed(list(enumerate(thresholds))):
            for result, alike in zip(levels, (cosine.abs(), cosine), strict=True):
                result[chunk][((distance <= radius) & (alike >= math.cos(angle))).any(dim=1)] = level
    return levels[0], levels[1]


def check_thresholds(thresholds: Sequence[tuple[float, float]]) -> None:
    """Reject thresholds (radius in metres, largest angle in radians) that do not go from strict to lax.

    Raises:
        ValueError: one decreases, the first radius is not positive, or there are none or more than eight.
    """
    growing = all(a[0] <= b[0] and a[1] <= b[1] for a, b in itertools.pairwise(thresholds))
    if not 0 < len(thresholds) <= MOST_LEVELS or not growing or thresholds[0][0] <= 0:
        raise ValueError(f"expected 1 to {MOST_LEVELS} growing (radius, angle) thresholds, found {list(thresholds)}")


def assign_locks(
    roots: Float[Tensor, "strand 3"], spacing: float, generator: torch.Generator
) -> Int64[Tensor, " strand"]:
    """The strand that leads each strand's lock: the nearest of the leaders, which are about `spacing` metres apart."""
    order = torch.randperm(len(roots), generator=generator, device=generator.device).cpu().numpy()
    places = roots.detach().cpu().numpy()
    cells = np.floor(places / (1.2 * spacing)).astype(np.int64)
    _, first = np.unique(cells[order], axis=0, return_index=True)
    leaders = order[first]
    nearest = KDTree(places[leaders]).query(places)[1]
    return torch.from_numpy(leaders[nearest]).to(roots.device)
