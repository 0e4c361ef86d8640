"""Fuse the lines of all views into one oriented cloud: contradicted lines are dropped, gaps are filled with guesses.

A line that other views confirm is nearly always hair. A line that none confirms is hair in four cases out of five,
mostly hair that no other view sees, which nothing else can replace. Such lines are thinned, and kept where no confirmed
line is near.
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.point_queries import nearest
from neural_strands.lmvs.consistency import LineCloud

GUESS = 0.1
"""Confidence of a guess; confirmed chains have more."""


def cell_keys(points: Float[Tensor, "point 3"], cell: float) -> Int64[Tensor, " point"]:
    """A number per point that identifies the cell of `cell` metres in which it lies."""
    index = torch.floor(points / cell).long() + 2**20
    return (index[:, 0] << 42) + (index[:, 1] << 21) + index[:, 2]


def fill_gaps(guesses: LineCloud, confirmed: LineCloud, cell: float) -> LineCloud:
    """The guess with the largest weight in each cell of `cell` metres that holds no confirmed line."""
    keys = cell_keys(guesses.points, cell)
    free = torch.nonzero(~torch.isin(keys, torch.unique(cell_keys(confirmed.points, cell)))).squeeze(1)
    # Stable sorts by weight, then by cell: the first point of each cell is its best, the earliest if several are equal.
    order = free[torch.argsort(guesses.weight[free], descending=True, stable=True)]
    order = order[torch.argsort(keys[order], stable=True)]
    first = torch.ones(len(order), dtype=torch.bool, device=keys.device)
    first[1:] = keys[order][1:] != keys[order][:-1]
    return guesses.select(order[first])


def best_share(cloud: LineCloud, share: float) -> LineCloud:
    """The share of the points with the largest weights."""
    order = torch.argsort(cloud.weight, descending=True, stable=True)
    return cloud.select(order[: round(share * len(order))])


def share_reached(
    space: Float[Tensor, "point 3"], points: Float[Tensor, "segment_point 3"], reach: float, most: int = 20_000
) -> float:
    """Share of the space that hair can occupy that has a segment's point within `reach` metres.

    Args:
        space: points spread evenly over that space; at most `most` of them are tested.
        points: points of segments.
        reach: largest distance, metres.
        most: largest number of points tested; 20,000 keep the standard error of the share below 0.4%.
    """
    tested = space[:: max(1, -(-len(space) // most))]
    if len(tested) == 0:
        return 1.0
    distance, _ = nearest(tested, points, reach)
    return float(torch.isfinite(distance).float().mean())


def add_guesses(segments: LineSegments, guesses: LineCloud, length: float) -> LineSegments:
    """Append every guess as a segment of two points, `length` metres apart."""
    count = len(guesses.points)
    half = 0.5 * length * guesses.directions
    ids = segments.segment_count + torch.arange(count, device=half.device)
    return LineSegments(
        torch.cat([segments.points, torch.stack([guesses.points - half, guesses.points + half], 1).reshape(-1, 3)]),
        torch.cat([segments.directions, guesses.directions.repeat_interleave(2, dim=0)]),
        torch.cat([segments.confidence, segments.confidence.new_full((2 * count,), GUESS)]),
        torch.cat([segments.segment_id, ids.repeat_interleave(2)]),
    )
