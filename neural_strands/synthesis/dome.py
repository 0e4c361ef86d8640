"""A dome of cameras, each of which sees all of the hair."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))
"""Turn between neighbours on the spiral (rad); azimuths never line up."""

SPREAD_POINTS = 100_000
"""Points of the hair from which the focal length is computed."""
MOST = 0.998
"""Share of the hair that has to fit, so that a single flyaway does not determine the scale of the rest."""


@dataclass(frozen=True)
class DomeConfig:
    """Positions and field of view of the cameras."""

    views: int = 24
    """Number of cameras."""
    resolution: int = 256
    """Width and height of the images (pixels)."""
    distance: float = 1.0
    """Distance from the camera to the middle of the hair (m)."""
    elevation_min: float = -25.0
    """Lowest camera, degrees above the horizontal (negative: below the chin, looking up)."""
    elevation_max: float = 75.0
    """Highest camera, degrees above the horizontal."""
    azimuth: float = 180.0
    """Farthest camera to either side of the face, degrees about the vertical; 180: all around."""
    fill: float = 0.9
    """Share of the frame that the hair fills in the view where it is largest (0 to 1)."""


def dome(points: Float[Tensor, "*strand 3"], config: DomeConfig) -> tuple[Camera, ...]:
    """Cameras on a spiral from the highest to the lowest elevation, evenly over the sphere between.

    All share one focal length: the longest with which the hair, except for the few points that stray furthest, stays
    within its share of every frame.

    Args:
        points: points of the hair, world metres.
        config: the dome.

    Raises:
        InputError: there are too few views, the elevations are in the wrong order, or cameras are inside the hair.
    """
    _check(config)
    flat = points.reshape(-1, 3)
    target = (flat.amin(dim=0) + flat.amax(dim=0)) / 2
    reach = float((flat - target).norm(dim=-1).max())
    if reach >= 0.9 * config.distance:
        raise InputError(
            f"distance: the hair reaches {reach:.2f} m from its middle, so cameras at {config.distance:g} m would "
            f"stand in it; use at least {1.2 * reach:.2f}."
        )
    size = (config.resolution, config.resolution)
    eyes = [target + config.distance * direction.to(target) for direction in dome_directions(config)]
    unit = [Camera.look_at(eye, target, 1.0, size, f"{index:03d}") for index, eye in enumerate(eyes)]
    middle = target.new_tensor([config.resolution / 2, config.resolution / 2])
    sample = flat[:: max(len(flat) // SPREAD_POINTS, 1)]
    spread = max(float((camera.project(sample)[0] - middle).abs().amax(dim=-1).quantile(MOST)) for camera in unit)
    focal = 0.5 * config.fill * config.resolution / spread
    return tuple(Camera.look_at(eye, target, focal, size, camera.name) for eye, camera in zip(eyes, unit, strict=True))


def dome_directions(config: DomeConfig) -> Float[Tensor, "view 3"]:
    """Unit vectors from the hair to each camera (y up, +z out of the face); the first camera is the highest."""
    high, low = (math.sin(math.radians(angle)) for angle in (config.elevation_max, config.elevation_min))
    share = (torch.arange(config.views) + 0.5) / config.views
    height = high + (low - high) * share
    radius = (1 - height**2).sqrt()
    azimuth = GOLDEN_ANGLE * torch.arange(config.views)
    if config.azimuth < 180.0:
        turn = (azimuth / (2 * math.pi)).remainder(1.0)
        azimuth = math.radians(config.azimuth) * (2 * turn - 1)
    return torch.stack([radius * azimuth.sin(), height, radius * azimuth.cos()], dim=-1)


def _check(config: DomeConfig) -> None:
    if config.views < 1:
        raise InputError(f"views: expected at least 1, found {config.views}.")
    if not 8 <= config.resolution <= 8192:
        raise InputError(f"resolution: expected 8 to 8192 pixels, found {config.resolution}.")
    if not -90.0 < config.elevation_min <= config.elevation_max < 90.0:
        raise InputError(
            f"elevation: expected -90 < min <= max < 90 degrees, found {config.elevation_min:g} and "
            f"{config.elevation_max:g}."
        )
    if not 0.0 < config.azimuth <= 180.0:
        raise InputError(f"azimuth: expected more than 0 and at most 180 degrees, found {config.azimuth:g}.")
    if not 0.0 < config.fill <= 1.0:
        raise InputError(f"fill: expected a share above 0 and at most 1, found {config.fill:g}.")
