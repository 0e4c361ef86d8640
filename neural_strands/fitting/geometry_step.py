"""The geometric step of a fit: all strands are remembered, and some are decoded with a gradient at each step."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.fit_data import FitData
from neural_strands.fitting.losses import coverage_loss, head_penalty, holding_loss, surface_loss
from neural_strands.foundation.devices.transfers import sent
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.strands import directions


@dataclass(frozen=True)
class ShapeLosses:
    """The terms of the geometric objective, for the log.

    Attributes:
        surface: distance of generated points from segments.
        coverage: distance of segments from generated points.
        head: depth inside the head.
        first: distance of points that views see from where they started.
        hidden: the same of the other points.
    """

    surface: Float[Tensor, ""]
    coverage: Float[Tensor, ""]
    head: Float[Tensor, ""]
    first: Float[Tensor, ""]
    hidden: Float[Tensor, ""]


@dataclass(frozen=True)
class StepStrands:
    """The strands of a step.

    Attributes:
        index: those that are decoded, in random order.
        others: all others, in order.
    """

    index: Int64[Tensor, " some"]
    others: Int64[Tensor, " other"]

    @classmethod
    def drawn(cls, count: int, some: int, random: torch.Generator, device: torch.device) -> "StepStrands":
        """Draw `some` of `count` strands, or all if there are fewer; on the host, which need not wait then."""
        index = torch.randperm(count, generator=random)[:some]
        is_other = torch.ones(count, dtype=torch.bool).index_fill_(0, index, False)
        return cls(sent(index, device), sent(is_other.nonzero().squeeze(1), device))


def hold_unreleased(points: Float[Tensor, "strand point 3"], released: float) -> Float[Tensor, "strand point 3"]:
    """The same strands; only the `released` share of each, counted from its root, passes gradients on (root to tip)."""
    free = round(released * points.shape[1])
    return points if free >= points.shape[1] else torch.cat([points[:, :free], points[:, free:].detach()], dim=1)


def shape_losses(
    strands: Float[Tensor, "some point 3"],
    chosen: StepStrands,
    remembered: Float[Tensor, "root point 3"],
    first: Float[Tensor, "root point 3"],
    seen: Bool[Tensor, "root point"],
    data: FitData,
    targets: Int64[Tensor, " target"],
    config: FitConfig,
) -> ShapeLosses:
    """The geometric objective of the strands that a step decoded.

    Segments look for their nearest point among all strands, remembered ones included, so that a strand only has to
    cover what no other strand covers better; only matches with the decoded strands carry a gradient.

    Args:
        strands: decoded with a gradient.
        chosen: which strands they are.
        remembered: all strands as last decoded.
        first: all strands as they started.
        seen: which points of all strands are visible in some view.
        data: segments and head.
        targets: indices of the segment points used in this step.
        config: weights, radii and clearance.
    """
    points, along = strands.reshape(-1, 3), directions(strands).reshape(-1, 3)
    others = remembered.index_select(0, chosen.others).reshape(-1, 3)
    # The mean strand runs across most segments at first.
    chamfer = config.chamfer if config.initialise == "flow" else replace(config.chamfer, alike=180.0)
    everything = PointGrid.build(torch.cat([points.detach(), others]), chamfer.radius)
    seen, first = seen[chosen.index], first[chosen.index]
    return ShapeLosses(
        surface_loss(points, along, seen.reshape(-1), everything, strands.shape[1], data.targets, chamfer),
        coverage_loss(points, along, everything, data.targets, targets, chamfer),
        head_penalty(strands, data.distance, config.clearance),
        holding_loss(strands, first, seen, chamfer.unit),
        holding_loss(strands, first, seen.logical_not(), chamfer.unit),
    )
