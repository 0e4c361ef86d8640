"""Schedules of the fit: pure functions of the step (paper, "Optimization Details")."""

import math
from dataclasses import dataclass
from typing import Annotated

from neural_strands.foundation.configs import Between


@dataclass(frozen=True)
class ScheduleConfig:
    """When each part of the fit starts and how fast it moves; durations are fractions of all steps.

    The defaults are for a fit that starts from the mean strand everywhere, as the paper's does.
    """

    widest_blur: Annotated[float, Between(0, 256)] = 16.0
    """Deviation in texels of the Gaussian that blurs the gradient of the shape texture at the first step."""
    blur_until: Annotated[float, Between(0, 1)] = 0.5
    """Fraction of the steps after which the gradient is no longer blurred."""
    release_until: Annotated[float, Between(0, 1)] = 0.3
    """Fraction of the steps after which the whole strand is free; before that, only the part nearest the root is."""
    geometry_only: Annotated[float, Between(0, 1)] = 0.3
    """Fraction of the steps during which rendering and alpha losses have no weight (the paper: 1,000 steps)."""
    appearance_blur: Annotated[float, Between(0, 256)] = 3.0
    """Deviation in texels of the Gaussian that blurs the gradient of the appearance texture: strands that few views see
    learn from their neighbours."""
    perceptual_from: Annotated[float, Between(0, 1)] = 0.5
    """Fraction of the steps after which the perceptual loss counts; earlier it is expensive and has little effect."""
    warmup: Annotated[int, Between(0, 10_000_000)] = 50
    """Steps over which learning rates rise from zero."""
    final_rate: Annotated[float, Between(0, 1)] = 0.1
    """Learning rate at the last step, as a fraction of the first."""


def blur_width(step: int, steps: int, config: ScheduleConfig) -> float:
    """Coarse to fine: deviation in texels of the gradient blur, falling geometrically to 1 texel and then to 0."""
    end = config.blur_until * steps
    if step >= end or config.widest_blur <= 0:
        return 0.0
    return config.widest_blur ** (1 - step / end) if config.widest_blur > 1 else config.widest_blur


def released_points(step: int, steps: int, points: int, config: ScheduleConfig) -> int:
    """Root to tip: how many points of each strand, from the root, receive a gradient; at least two, then all."""
    end = config.release_until * steps
    if step >= end:
        return points
    return min(points, 2 + math.floor((points - 2) * step / end))


def appearance_begins(steps: int, config: ScheduleConfig) -> int:
    """The first step whose rendering and alpha losses count."""
    return math.ceil(config.geometry_only * steps)


def rate_factor(step: int, steps: int, config: ScheduleConfig) -> float:
    """Factor of the learning rates: a short linear rise, then a cosine fall."""
    rise = min(1.0, (step + 1) / max(config.warmup, 1))
    fall = 0.5 * (1 + math.cos(math.pi * min(step / max(steps, 1), 1.0)))
    return rise * (config.final_rate + (1 - config.final_rate) * fall)
