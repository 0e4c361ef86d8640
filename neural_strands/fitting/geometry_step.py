"""Strands during a fit: all of them remembered, some of them decoded anew with a gradient at each step."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.fitting.config import FitConfig
from neural_strands.fitting.fit_data import FitData
from neural_strands.fitting.losses import coverage_loss, head_penalty, holding_loss, surface_loss
from neural_strands.geometry.frames import to_world
from neural_strands.geometry.strands import directions
from neural_strands.model.hair_model import HairModel


@dataclass(frozen=True)
class ShapeLosses:
    """The parts of the geometric objective, for the log.

    Attributes:
        surface: generated points against segments.
        coverage: segments against generated points.
        head: depth inside the head.
        first: how far strands are from where they began.
    """

    surface: Float[Tensor, ""]
    coverage: Float[Tensor, ""]
    head: Float[Tensor, ""]
    first: Float[Tensor, ""]


def decode_some(
    model: HairModel, index: Int64[Tensor, " some"], points: int, blur: float, released: float
) -> Float[Tensor, "some point 3"]:
    """Decode the strands of some roots; points beyond the released share of the strand pass no gradient on.

    Args:
        model: textures, generator and roots.
        index: which roots.
        points: points a strand.
        blur: deviation in texels of the blur of the gradient into Z_g (coarse to fine).
        released: share of the strand from the root that learns (root to tip), in [0, 1].
    """
    latent = model.textures.sample_shape(model.root_uv[index], blur)
    local = model.generator(latent, points)
    free = round(released * points)
    if free < points:
        local = torch.cat([local[:, :free], local[:, free:].detach()], dim=1)
    return to_world(local, model.root_position[index], model.root_frame[index])


def shape_losses(
    strands: Float[Tensor, "some point 3"],
    index: Int64[Tensor, " some"],
    remembered: Float[Tensor, "root point 3"],
    first: Float[Tensor, "root point 3"],
    data: FitData,
    chosen: Int64[Tensor, " target"],
    config: FitConfig,
) -> ShapeLosses:
    """The geometric objective of the strands that a step decoded.

    Segments look for their nearest point among all strands, remembered ones included, so that a strand is only asked
    to cover what no other strand covers better; only matches with the decoded strands carry a gradient.
    """
    points, along = strands.reshape(-1, 3), directions(strands).reshape(-1, 3)
    rest = torch.ones(len(remembered), dtype=torch.bool, device=index.device)
    rest[index] = False
    others = remembered[rest].reshape(-1, 3)
    return ShapeLosses(
        surface_loss(points, along, data.targets, config.chamfer),
        coverage_loss(points, along, others, data.targets, chosen, config.chamfer),
        head_penalty(strands, data.distance, config.clearance),
        holding_loss(strands, first[index], config.chamfer.unit),
    )
