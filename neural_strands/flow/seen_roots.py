"""Where the hair begins that the photographs show: segments followed back to the scalp.

Roots that are spread evenly over the scalp leave much of the visible hair to few strands, because hair from a small
part of the scalp may cover all the rest. Strands from the roots found here pass through what views see.
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.field import FlowField
from neural_strands.flow.tracing import TraceConfig, follow
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.point_queries import nearest

APART = 0.004
"""Edge of the cells from each of which one point of the segments is followed, metres: hair is followed from everywhere
alike, however many segments stereo found there."""
ROOTED = 0.0005
"""Height above the head at which a streamline has reached it, metres."""
NEAR_ROOTS = 0.006
"""Largest distance from a root of the scalp to a place where a streamline meets the head, metres; elsewhere, it has met
the face or the body."""


def seen_roots(
    field: FlowField,
    segments: LineSegments,
    scalp_points: Float[Tensor, "root 3"],
    most: int,
    distance: SignedDistanceGrid,
    config: TraceConfig,
    generator: torch.Generator,
) -> Float[Tensor, "found 3"]:
    """Places on the scalp from which hair leads to the segments, in random order; some may coincide.

    Args:
        field: directions of the hair.
        segments: confident line segments.
        scalp_points: roots that are spread over the scalp.
        most: largest number of points to follow.
        distance: signed distance to the head.
        config: step and longest way.
        generator: draws the points to follow, on the CPU.
    """
    chosen = one_in_each_cell(segments.points, APART, generator)[:most]
    ends = trace_back(field, segments.points[chosen], segments.directions[chosen], distance, config)
    beside, _ = nearest(ends, scalp_points, radius=NEAR_ROOTS)
    return ends[beside.isfinite()]


def one_in_each_cell(
    points: Float[Tensor, "point 3"], edge: float, generator: torch.Generator
) -> Int64[Tensor, " cell"]:
    """Indices of one random point in each occupied cell of a grid, in random order.

    Args:
        points: positions, metres.
        edge: edge of a cell, metres.
        generator: draws the order, on the CPU.
    """
    order = torch.randperm(len(points), generator=generator, device=generator.device).to(points.device)
    _, cell = torch.unique(torch.floor(points[order] / edge).long(), dim=0, return_inverse=True)
    count = int(cell.max()) + 1 if len(points) else 0
    place = torch.arange(len(points), device=points.device)
    first = place.new_full((count,), len(points)).scatter_reduce_(0, cell, place, "amin")
    return order[first.sort().values]


def trace_back(
    field: FlowField,
    points: Float[Tensor, "point 3"],
    directions: Float[Tensor, "point 3"],
    distance: SignedDistanceGrid,
    config: TraceConfig,
) -> Float[Tensor, "end 3"]:
    """Follow the flow from points in the hair back to the head; those that do not reach it are left out.

    Args:
        field: directions of the hair.
        points: where to start, metres.
        directions: growth directions there, followed where the field vanishes.
        distance: signed distance to the head.
        config: step and longest way.
    """
    position, direction = points, functional.normalize(directions, dim=-1)
    arrived = distance(position) <= ROOTED
    for _ in range(int(config.longest / config.step)):
        first = follow(field, position, direction)
        second = follow(field, position - 0.5 * config.step * first, first)
        position = torch.where(arrived[:, None], position, position - config.step * second)
        direction = second
        arrived = arrived | (distance(position) <= ROOTED)
        if bool(arrived.all()):
            break
    return position[arrived]
