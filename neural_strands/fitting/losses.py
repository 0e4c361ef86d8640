"""The losses of the fit (paper, "End-to-End Optimization"), each a pure function.

The paper defines the losses as sums, which depend on how many points and pixels a step uses. Here every term is a mean:
the geometric loss over the points of each side, the rendering and alpha losses over pixels. `FitWeights` converts the
paper's weights.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.foundation.devices.selection import selected
from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import nearest

Perceptual = Callable[[Float[Tensor, "height width 3"], Float[Tensor, "height width 3"]], Float[Tensor, ""]]
"""Perceptual distance between a rendered and a photographed image, such as LPIPS."""


@dataclass(frozen=True)
class ChamferConfig:
    """How generated points are compared with segments."""

    radius: Annotated[float, Between(1e-5, 10)] = 0.02
    """Largest distance of a neighbour that counts, metres."""
    surface_radius: Annotated[float, Between(1e-5, 10)] = 0.0015
    """Generated points farther than this from every segment, metres, count as hidden and are not pulled to the
    surface."""
    occupied: Annotated[float, Between(1e-5, 10)] = 0.00075
    """A segment pulls no strand if another one is nearer than this, metres: it shows a single hair."""
    alike: Annotated[float, Between(0, 180)] = 30.0
    """A strand and a segment whose directions differ by more than this, degrees, are different hairs, and neither pulls
    the other: curls whose phases are unknown cross many segments. A fit from the mean strand has no such limit."""
    unit: Annotated[float, Between(1e-5, 10)] = 0.002
    """The distance that costs as much as a direction error of 90 degrees, metres."""
    signed: bool = False
    """Whether a direction opposite to the segment's counts as an error."""


@dataclass(frozen=True)
class OrientedTargets:
    """The line segments, prepared for the geometric loss.

    Attributes:
        points: positions, metres.
        directions: unit tangents.
        grid: the positions indexed for searches within `ChamferConfig.surface_radius`.
    """

    points: Float[Tensor, "y 3"]
    directions: Float[Tensor, "y 3"]
    grid: PointGrid


def surface_loss(
    points: Float[Tensor, "x 3"],
    directions: Float[Tensor, "x 3"],
    seen: Bool[Tensor, " x"],
    everything: PointGrid,
    per_strand: int,
    targets: OrientedTargets,
    config: ChamferConfig,
) -> Float[Tensor, ""]:
    """Generated points against their nearest segment point (paper, L_geo, first sum), as a mean.

    Only points that are visible in some view and lie near a segment count. Hidden hair has no segments; pulling it to
    those above it would leave a gap. For the same reason a segment that one strand follows pulls no other. Points that
    run across their segment count, but cost nothing.

    Args:
        points: generated points, strand after strand.
        directions: their unit directions.
        seen: whether they are visible in some view.
        everything: the points of all strands, these first, indexed for searches.
        per_strand: points of each strand.
        targets: the line segments.
        config: radii and unit.
    """
    own, counts = selected(seen, (torch.arange(len(points), device=points.device), seen))
    _, index = nearest(points.detach().index_select(0, own), targets.grid, config.surface_radius)
    counts = counts & (index >= 0)
    own, index, counts = selected(counts, (own, index.clamp(min=0), counts))
    _, first = nearest(targets.points.index_select(0, index), everything, config.occupied)
    counts = counts & ((first < 0) | (first // per_strand == own // per_strand))
    own, index, counts = selected(counts, (own, index, counts))
    return _mean_misfit(points, directions, own, targets, index, counts, config)


def coverage_loss(
    points: Float[Tensor, "x 3"],
    directions: Float[Tensor, "x 3"],
    everything: PointGrid,
    targets: OrientedTargets,
    chosen: Int64[Tensor, " target"],
    config: ChamferConfig,
) -> Float[Tensor, ""]:
    """Chosen segment points against their nearest generated point (paper, L_geo, second sum), as a mean.

    Targets that run across this point count, but cost nothing.

    Args:
        points: generated points that carry a gradient.
        directions: their unit directions.
        everything: the points of all strands, these first, indexed for searches. Targets nearest to another point are
            skipped in this step.
        targets: the line segments.
        chosen: indices of the targets used in this step.
        config: radii and unit.
    """
    distance, index = nearest(targets.points[chosen], everything, config.radius)
    counts = torch.isfinite(distance) & (index < len(points))
    index, chosen, counts = selected(counts, (torch.where(counts, index, 0), chosen, counts))
    return _mean_misfit(points, directions, index, targets, chosen, counts, config)


def rendering_loss(
    image: Float[Tensor, "height width 3"],
    target: Float[Tensor, "height width 3"],
    weight: Float[Tensor, "height width"] | None = None,
) -> Float[Tensor, ""]:
    """Mean squared error over pixels and channels (paper, L_render without its LPIPS term)."""
    squared = (image - target).square().mean(dim=-1)
    return squared.mean() if weight is None else (squared * weight).sum() / weight.sum().clamp(min=1.0)


def alpha_loss(
    alpha: Float[Tensor, "height width"],
    reference: Float[Tensor, "height width"],
    supervised: Bool[Tensor, "height width"],
) -> Float[Tensor, ""]:
    """Mean squared error of the alpha map over the pixels where the trimap is certain (paper, L_alpha)."""
    squared = (alpha - reference).square() * supervised
    return squared.sum() / supervised.sum().clamp(min=1)


def head_penalty(
    points: Float[Tensor, "strand point 3"], head: SignedDistanceGrid, clearance: float
) -> Float[Tensor, ""]:
    """Mean squared depth, in units of the clearance, of points closer to the head than `clearance` metres.

    The first tenth of every strand is exempt, because it emerges from the scalp.
    """
    free = points[:, points.shape[1] // 10 :].reshape(-1, 3)
    depth = torch.relu(clearance - head(free))
    return (depth / clearance).square().mean()


def holding_loss(
    points: Float[Tensor, "strand point 3"],
    first: Float[Tensor, "strand point 3"],
    held: Bool[Tensor, "strand point"],
    unit: float,
) -> Float[Tensor, ""]:
    """Squared distance of held points from their start, in multiples of `unit`, as a mean over all points."""
    return (((points - first) / unit).square().sum(dim=-1) * held).mean()


def _mean_misfit(
    points: Float[Tensor, "x 3"],
    directions: Float[Tensor, "x 3"],
    index: Int64[Tensor, " pair"],
    targets: OrientedTargets,
    chosen: Int64[Tensor, " pair"],
    counts: Bool[Tensor, " pair"],
    config: ChamferConfig,
) -> Float[Tensor, ""]:
    """Mean distance and direction error of the pairs that count; zero, with zero gradient, if there are none.

    Pairs of different hairs cost nothing, so the fewer are alike, the less the others pull.
    """
    # With `points[index]`, threads would sum gradients in an order that differs from run to run.
    points, directions = points.index_select(0, index), directions.index_select(0, index)
    offset = points - targets.points[chosen]
    distance = (offset.square().sum(dim=-1) + 1e-12).sqrt() / config.unit
    cosine = (directions * targets.directions[chosen]).sum(dim=-1)
    cosine = cosine if config.signed else cosine.abs()
    alike = counts & (cosine.detach() >= math.cos(math.radians(config.alike)))
    return torch.where(alike, distance + 1 - cosine, 0.0).sum() / counts.sum().clamp(min=1)
