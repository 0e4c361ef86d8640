"""Directions from which a model was photographed, and rendering from elsewhere.

Shading and image generator have learned only the directions of the photographs; for others they return arbitrary
colours (black, purple, holes). A camera that looks from where no photograph was taken therefore sees the hair as if the
head were turned towards the cameras that took some. Every direction that the networks see is rotated, first about the
vertical, so that up stays up. Near the photographs nothing is rotated.

Appearance learned from hair that photographs only graze is right for them and wrong from elsewhere, where the same hair
faces the camera; between, the two textures of `ScalpTextures` are blended.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation.smoothstep import smoothstep

LEAST_SLACK = math.radians(15)
"""Least value of the angle to the nearest photograph up to which nothing is rotated. At 30 degrees, networks that had
learned from photographs within 26 degrees drew a green haze over black hair, from 20 degrees away on."""
SPACINGS = 1.5
"""The same angle, as a multiple of the widest gap between neighbouring photographs: networks interpolate within it. It
is also the angle from which on a camera looks from elsewhere, and half of it where it begins to."""
LEAST_GAP = math.radians(1)
"""Narrower gaps between photographs count as this wide."""
SHARPNESS = 3.0
"""How much more strongly nearer photographs attract, per unit of the cosine (a softmax's inverse temperature)."""
LEVEL = 1e-3
"""A unit direction whose horizontal part is shorter than this has no azimuth."""


@dataclass(frozen=True)
class Viewpoint:
    """Where a camera stands among the photographs, which decides how appearance is looked up.

    Attributes:
        turn: rotation of the directions that networks see, or None if they stay (`turn_to_seen`).
        elsewhere: how far the camera is from all photographs, from 0 to 1 (`share_elsewhere`).
        functions: view functions of its direction, after the rotation (`model.view_functions`).
    """

    turn: Float[Tensor, "3 3"] | None
    elsewhere: float
    functions: Float[Tensor, " function"]


def seen_from(positions: Float[Tensor, "view 3"], centre: Float[Tensor, "3"]) -> Float[Tensor, "view 3"]:
    """Unit directions from the hair to the cameras that photographed it."""
    return F.normalize(positions - centre, dim=1)


def turn_to_seen(place: Float[Tensor, "3"], seen: Float[Tensor, "view 3"]) -> Float[Tensor, "3 3"] | None:
    """Compute the rotation that turns a camera's directions towards those that were photographed.

    Args:
        place: position of the camera relative to the hair's centre; any length.
        seen: unit directions to the cameras of the photographs.

    Returns:
        A rotation matrix, or None if a photograph is near enough or there are none.
    """
    if len(seen) == 0 or float(place.norm()) == 0:
        return None
    unit = F.normalize(place, dim=0)
    cosine = seen @ unit
    gap, slack = _angle_to_nearest(unit, seen), _slack(seen)
    if gap <= slack:
        return None
    goal = F.normalize((torch.softmax(SHARPNESS * cosine, dim=0)[:, None] * seen).sum(dim=0), dim=0)
    share = smoothstep((gap - slack) / slack)
    across, height = _azimuth(goal, unit), math.asin(float(goal[1].clamp(-1, 1))) - math.asin(float(unit[1]))
    about = _rotation(place.new_tensor([0.0, 1.0, 0.0]), share * across)
    turned = about @ unit
    level = F.normalize(torch.stack([-turned[2], torch.zeros_like(turned[0]), turned[0]]), dim=0)
    return _rotation(level, share * height) @ about


def share_elsewhere(place: Float[Tensor, "3"], seen: Float[Tensor, "view 3"]) -> float:
    """How much a camera looks from elsewhere than the photographs: 0 between them, 1 far from all.

    Args:
        place: position of the camera relative to the hair's centre; any length.
        seen: unit directions to the cameras of the photographs; without any, nothing is elsewhere.
    """
    if len(seen) == 0 or float(place.norm()) == 0:
        return 0.0
    gap = _angle_to_nearest(F.normalize(place, dim=0), seen)
    return smoothstep(2 * gap / (SPACINGS * _widest_gap(seen)) - 1)


def usual_gap(seen: Float[Tensor, "view 3"]) -> float:
    """Median angle between a photograph and its nearest neighbour, radians; infinite with fewer than two."""
    if len(seen) < 2:
        return math.inf
    cosine = (seen @ seen.T).fill_diagonal_(-1.0)
    return math.acos(float(cosine.amax(dim=1).median().clamp(-1, 1)))


def _angle_to_nearest(unit: Float[Tensor, "3"], seen: Float[Tensor, "view 3"]) -> float:
    return math.acos(min(1.0, float((seen @ unit).max())))


def _slack(seen: Float[Tensor, "view 3"]) -> float:
    """Angle up to which nothing is rotated."""
    return max(LEAST_SLACK, SPACINGS * _widest_gap(seen))


def _widest_gap(seen: Float[Tensor, "view 3"]) -> float:
    """Largest angle between a photograph and its nearest neighbour; with a single one, that of the least slack."""
    if len(seen) < 2:
        return LEAST_SLACK / SPACINGS
    cosine = (seen @ seen.T).fill_diagonal_(-1.0)
    return max(LEAST_GAP, math.acos(float(cosine.amax(dim=1).min().clamp(-1, 1))))


def _azimuth(goal: Float[Tensor, "3"], start: Float[Tensor, "3"]) -> float:
    """Angle about the y axis from `start` to `goal`, in [-pi, pi]; 0 if either has no azimuth."""
    if min(float(goal[::2].norm()), float(start[::2].norm())) < LEVEL:
        return 0.0
    angle = math.atan2(float(goal[0]), float(goal[2])) - math.atan2(float(start[0]), float(start[2]))
    return math.remainder(angle, 2 * math.pi)


def _rotation(axis: Float[Tensor, "3"], angle: float) -> Float[Tensor, "3 3"]:
    """Rotation by an angle about a unit axis (Rodrigues)."""
    x, y, z = axis.tolist()
    cross = axis.new_tensor([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return torch.eye(3).to(axis) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
