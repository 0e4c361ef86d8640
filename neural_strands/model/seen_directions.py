"""Where a model was seen from, and how it is looked at from elsewhere.

Shading and image generator know the directions of the photographs alone; what they make of others is arbitrary (black,
purple, holes). So a camera that looks from where no photograph was taken sees the hair as if the head were turned
towards the cameras that took some: every direction that the networks see is turned, about the vertical first, so that
up stays up. Near the photographs nothing is turned.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

LEAST_SLACK = math.radians(30)
"""Angle to the nearest photograph up to which nothing is turned, at least."""
SPACINGS = 1.5
"""The same, in angles between neighbouring photographs: between them the networks interpolate."""
SHARPNESS = 3.0
"""How strongly the nearer photographs attract, per unit of the cosine."""
LEVEL = 1e-3
"""Horizontal part of a unit direction below which it has no azimuth."""


def seen_from(positions: Float[Tensor, "view 3"], centre: Float[Tensor, "3"]) -> Float[Tensor, "view 3"]:
    """Unit directions from the hair to the cameras that photographed it."""
    return F.normalize(positions - centre, dim=1)


def turn_to_seen(place: Float[Tensor, "3"], seen: Float[Tensor, "view 3"]) -> Float[Tensor, "3 3"] | None:
    """The rotation of directions after which a camera looks from where photographs were taken.

    Args:
        place: of the camera, from the hair's centre; any length.
        seen: unit directions to the cameras of the photographs.

    Returns:
        None where photographs are near enough, or there are none.
    """
    if len(seen) == 0 or float(place.norm()) == 0:
        return None
    unit = F.normalize(place, dim=0)
    cosine = seen @ unit
    gap, slack = math.acos(min(1.0, float(cosine.max()))), _slack(seen)
    if gap <= slack:
        return None
    goal = F.normalize((torch.softmax(SHARPNESS * cosine, dim=0)[:, None] * seen).sum(dim=0), dim=0)
    part = min(1.0, (gap - slack) / slack)
    share = part * part * (3 - 2 * part)
    across, height = _azimuth(goal, unit), math.asin(float(goal[1].clamp(-1, 1))) - math.asin(float(unit[1]))
    about = _rotation(place.new_tensor([0.0, 1.0, 0.0]), share * across)
    turned = about @ unit
    level = F.normalize(torch.stack([-turned[2], torch.zeros_like(turned[0]), turned[0]]), dim=0)
    return _rotation(level, share * height) @ about


def _slack(seen: Float[Tensor, "view 3"]) -> float:
    """Angle up to which a direction counts as seen: the widest gap between neighbours, and some more."""
    if len(seen) < 2:
        return LEAST_SLACK
    cosine = (seen @ seen.T).fill_diagonal_(-1.0)
    return max(LEAST_SLACK, SPACINGS * math.acos(float(cosine.amax(dim=1).min().clamp(-1, 1))))


def _azimuth(goal: Float[Tensor, "3"], start: Float[Tensor, "3"]) -> float:
    """Angle about the y axis from one direction to the other, in (-pi, pi]; 0 if one has no azimuth."""
    if min(float(goal[::2].norm()), float(start[::2].norm())) < LEVEL:
        return 0.0
    angle = math.atan2(float(goal[0]), float(goal[2])) - math.atan2(float(start[0]), float(start[2]))
    return math.remainder(angle, 2 * math.pi)


def _rotation(axis: Float[Tensor, "3"], angle: float) -> Float[Tensor, "3 3"]:
    """Rotation by an angle about a unit axis (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = axis.new_tensor([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return torch.eye(3).to(axis) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
