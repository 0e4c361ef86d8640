"""First strands: streamlines of the flow from the scalp outwards."""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.field import FlowField
from neural_strands.foundation.configs import Between
from neural_strands.geometry.resample import resample_polyline_lengths


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


def trace_strands(
    field: FlowField,
    roots: Float[Tensor, "root 3"],
    normals: Float[Tensor, "root 3"],
    config: TraceConfig | None = None,
) -> Float[Tensor, "root point 3"]:
    """Follow the growth directions from each root until the hair volume ends; resampled by arc length.

    Args:
        field: directions and the volume that holds hair.
        roots: where strands start, metres.
        normals: outward unit normals there, followed where the field vanishes.
        config: step and limits.
    """
    config = config or TraceConfig()
    steps = max(int(config.longest / config.step), 2)
    inside = field.domain.to(field.directions)[..., None]
    position, direction = roots, functional.normalize(normals, dim=-1)
    alive = torch.ones(len(roots), dtype=torch.bool, device=roots.device)
    path = [position]
    for step in range(steps):
        first = _follow(field, position, direction)
        middle = position + 0.5 * config.step * first
        second = _follow(field, middle, first)
        ahead = position + config.step * second
        travelled = (step + 1) * config.step
        if travelled > config.grace:
            alive = alive & (field.grid.sample(inside, ahead, outside="border")[:, 0] >= 0.5)
        if travelled > config.shortest and not bool(alive.any()):
            break
        moving = alive | (travelled <= config.shortest)
        position = torch.where(moving[:, None], ahead, position)
        direction = torch.where(moving[:, None], second, direction)
        path.append(position)
    return resample_polyline_lengths(torch.stack(path, dim=1), config.points)


def _follow(
    field: FlowField, position: Float[Tensor, "root 3"], fallback: Float[Tensor, "root 3"]
) -> Float[Tensor, "root 3"]:
    """Unit direction at a position; the fallback where the field vanishes."""
    sampled = field.grid.sample(field.directions, position, outside="border")
    weak = sampled.norm(dim=-1, keepdim=True) < 1e-3
    return functional.normalize(torch.where(weak, fallback, sampled), dim=-1)
