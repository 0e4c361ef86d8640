"""Initial strands: streamlines of the flow from the scalp outwards."""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.field import FlowField
from neural_strands.foundation.configs import Between
from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.geometry.strands import lengths

MOSTLY = 0.5
"""The length of a strand with more than this share of unseen points is limited to that expected from hair nearby."""
LONGEST = 0.8
"""It is also limited to this quantile of the lengths of strands that are mostly seen."""
MOST_KNOWN = 2000
"""Largest number of strands from which lengths are estimated; if there are more, they are sampled evenly."""
NEARBY = 0.02
"""Metres added to distances, so that strands nearer than this count about equally instead of the nearest deciding
alone."""


@dataclass(frozen=True)
class TraceConfig:
    """The integration of streamlines."""

    step: Annotated[float, Between(1e-5, 1)] = 0.0015
    """Arc length of one midpoint (second order Runge-Kutta) step, metres."""
    longest: Annotated[float, Between(1e-4, 10)] = 0.6
    """Length at which every strand ends, metres."""
    shortest: Annotated[float, Between(0, 10)] = 0.01
    """Length below which a strand is continued along its last direction, metres."""
    grace: Annotated[float, Between(0, 10)] = 0.01
    """Arc length from the root within which leaving the hair volume does not end a strand, metres."""
    points: Annotated[int, Between(2, 10_000)] = 100
    """Points of each resulting strand."""


@dataclass(frozen=True)
class TracedStrands:
    """Streamlines of a flow.

    Attributes:
        points: polylines, root first, evenly spaced.
        unseen: share of each strand's points that lie where no view sees.
    """

    points: Float[Tensor, "root point 3"]
    unseen: Float[Tensor, " root"]


def trace_hair(
    field: FlowField,
    roots: Float[Tensor, "root 3"],
    normals: Float[Tensor, "root 3"],
    config: TraceConfig | None = None,
) -> TracedStrands:
    """Trace a strand from each root; those that no view sees are limited to the length of seen ones nearby.

    Args:
        field: directions, the volume that holds hair, and which part of it no view sees.
        roots: where strands start, metres.
        normals: outward unit normals there, followed where the field vanishes.
        config: step and limits.
    """
    config = config or TraceConfig()
    points = trace_strands(field, roots, normals, config)
    if field.unseen is None:
        return TracedStrands(points, torch.zeros_like(points[:, 0, 0]))
    unseen = _unseen_share(field, points)
    known, guessed = unseen <= MOSTLY, unseen > MOSTLY
    if bool(guessed.any()) and bool(known.any()):
        length = lengths(points)
        seen = torch.where(known, length, (1 - unseen) * length)
        most = expected_lengths(seen, known, roots, roots[guessed])
        in_order = length[known].sort().values
        most = most.minimum(in_order[round(LONGEST * (len(in_order) - 1))])
        points[guessed] = trace_strands(field, roots[guessed], normals[guessed], config, most)
        unseen = _unseen_share(field, points)
    return TracedStrands(points, unseen)


def expected_lengths(
    seen: Float[Tensor, " strand"],
    known: Bool[Tensor, " strand"],
    roots: Float[Tensor, "strand 3"],
    places: Float[Tensor, "place 3"],
) -> Float[Tensor, " place"]:
    """Estimate the length of hair at other places, from strands of which views may see only a part.

    A partly seen strand is at least as long as its seen part. Counting only strands that are seen completely would
    underrate long hair. If a strand is equally likely to end anywhere, the maximum-likelihood mean length is the total
    seen length divided by the number of strands seen completely (Epstein and Sobel 1953). Both sums are over strands,
    weighted by the inverse fourth power of the distance (Shepard 1968).

    Args:
        seen: seen length of each strand, metres.
        known: whether that is its whole length; true for at least one strand.
        roots: roots of the strands, metres.
        places: where lengths are wanted, metres.
    """
    every = max(1, len(roots) // MOST_KNOWN)
    seen, known, roots = seen[::every], known[::every].to(seen), roots[::every]
    parts = []
    for part in places.split(MOST_KNOWN):
        weight = (torch.cdist(part, roots) + NEARBY).pow(-4)
        parts.append((weight @ seen) / (weight @ known))
    return torch.cat(parts)


def _unseen_share(field: FlowField, points: Float[Tensor, "root point 3"]) -> Float[Tensor, " root"]:
    """Share of each strand's points whose voxel no view sees."""
    if field.unseen is None:
        return torch.zeros_like(points[:, 0, 0])
    index, inside = field.grid.index(points.reshape(-1, 3))
    unseen = field.unseen.reshape(-1)[index] & inside
    return unseen.reshape(points.shape[:2]).float().mean(dim=1)


def trace_strands(
    field: FlowField,
    roots: Float[Tensor, "root 3"],
    normals: Float[Tensor, "root 3"],
    config: TraceConfig | None = None,
    most: Float[Tensor, " root"] | None = None,
) -> Float[Tensor, "root point 3"]:
    """Follow the growth directions from each root until the hair volume ends; resampled by arc length.

    Args:
        field: directions and the volume that holds hair.
        roots: where strands start, metres.
        normals: outward unit normals there, followed where the field vanishes.
        config: step and limits.
        most: largest length of each strand, metres.
    """
    config = config or TraceConfig()
    steps = max(int(config.longest / config.step), 2)
    inside = field.domain.to(field.directions)[..., None]
    position, direction = roots, functional.normalize(normals, dim=-1)
    alive = torch.ones(len(roots), dtype=torch.bool, device=roots.device)
    path = [position]
    for step in range(steps):
        first = follow(field, position, direction)
        middle = position + 0.5 * config.step * first
        second = follow(field, middle, first)
        ahead = position + config.step * second
        travelled = (step + 1) * config.step
        if travelled > config.grace:
            # There is no hair beyond the grid, whatever the values at its border.
            _, within = field.grid.index(ahead)
            alive = alive & within & (field.grid.sample(inside, ahead, outside="border")[:, 0] >= 0.5)
        if most is not None:
            alive = alive & (travelled <= most)
        if travelled > config.shortest and not bool(alive.any()):
            break
        moving = alive | (travelled <= config.shortest)
        position = torch.where(moving[:, None], ahead, position)
        direction = torch.where(moving[:, None], second, direction)
        path.append(position)
    return resample_polyline_lengths(torch.stack(path, dim=1), config.points)


def follow(
    field: FlowField, position: Float[Tensor, "root 3"], fallback: Float[Tensor, "root 3"]
) -> Float[Tensor, "root 3"]:
    """Unit direction at a position; the fallback where the field vanishes."""
    sampled = field.at(position)
    weak = sampled.norm(dim=-1, keepdim=True) < 1e-3
    return functional.normalize(torch.where(weak, fallback, sampled), dim=-1)
