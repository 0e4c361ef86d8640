"""The losses of the fit (paper, "End-to-End Optimization"), each a pure function.

Sums and means. The paper prints sums, whose size depends on how many points and pixels a step sees. Here every term is
a mean: the geometric loss over the points of each side, the rendering and alpha losses over pixels. `FitWeights` says
what the paper's weights become.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.geometry.nearest import nearest
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.signed_distance import SignedDistanceGrid


@dataclass(frozen=True)
class ChamferConfig:
    """How generated points and segments are compared."""

    radius: float = 0.02
    """Farthest neighbour that counts, metres."""
    surface_radius: float = 0.004
    """Generated points farther than this from every segment are hidden, and not pulled to the surface, metres."""
    unit: float = 0.002
    """The distance that weighs as much as a direction off by 90 degrees, metres."""
    signed: bool = False
    """Whether a direction opposite to its segment's counts as wrong."""


def geometric_loss(
    points: Float[Tensor, "x 3"],
    directions: Float[Tensor, "x 3"],
    targets: Float[Tensor, "y 3"],
    target_directions: Float[Tensor, "y 3"],
    config: ChamferConfig,
    target_grid: PointGrid | None = None,
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """Two-way Chamfer on positions and directions (paper, L_geo), as means over each side.

    Args:
        points: generated points, metres.
        directions: their unit directions.
        targets: points of the line segments, metres.
        target_directions: their unit directions.
        config: radii and unit.
        target_grid: the targets indexed for a radius of `surface_radius`, when many steps share them.

    Returns:
        The term of generated points near the surface, and the term of targets.
    """
    surface = target_grid if target_grid is not None else targets
    distance, index = nearest(points.detach(), surface, config.surface_radius)
    near = torch.nonzero(index >= 0).squeeze(1)
    forward = _mean_misfit(points[near], directions[near], targets[index[near]], target_directions[index[near]], config)
    distance, index = nearest(targets, points.detach(), config.radius)
    found = torch.nonzero(torch.isfinite(distance)).squeeze(1)
    index = index[found]
    backward = _mean_misfit(points[index], directions[index], targets[found], target_directions[found], config)
    return forward, backward


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
    """Mean squared error of the alpha map over the pixels that the trimap is sure of (paper, L_alpha)."""
    squared = (alpha - reference).square() * supervised
    return squared.sum() / supervised.sum().clamp(min=1)


def head_penalty(
    points: Float[Tensor, "strand point 3"], head: SignedDistanceGrid, clearance: float
) -> Float[Tensor, ""]:
    """Mean squared depth, in units of the clearance, of points closer to the head than `clearance` metres.

    The first tenth of every strand is left free: it has to leave the scalp.
    """
    free = points[:, points.shape[1] // 10 :].reshape(-1, 3)
    depth = torch.relu(clearance - head.distance(free))
    return (depth / clearance).square().mean()


def smoothness(
    points: Float[Tensor, "strand point 3"], neighbours: Float[Tensor, "strand point 3"], unit: float
) -> Float[Tensor, ""]:
    """Mean squared difference between the shapes of neighbouring strands, seen from their roots, in `unit` metres."""
    shape = points - points[:, :1]
    other = neighbours - neighbours[:, :1]
    return ((shape - other) / unit).square().sum(dim=-1).mean()


def _mean_misfit(
    points: Float[Tensor, "pair 3"],
    directions: Float[Tensor, "pair 3"],
    targets: Float[Tensor, "pair 3"],
    target_directions: Float[Tensor, "pair 3"],
    config: ChamferConfig,
) -> Float[Tensor, ""]:
    """Mean over pairs of distance and direction error; zero, with a gradient of zero, where there is no pair."""
    if len(points) == 0:
        return points.sum() + directions.sum()
    offset = points - targets
    distance = (offset.square().sum(dim=-1) + 1e-12).sqrt() / config.unit
    cosine = (directions * target_directions).sum(dim=-1)
    cosine = cosine if config.signed else cosine.abs()
    return (distance + 1 - cosine).mean()
