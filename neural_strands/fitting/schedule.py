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
    """Standard deviation, in texels, of the Gaussian that blurs the gradient of the shape texture at the first step."""
    blur_until: Annotated[float, Between(0, 1)] = 0.5
    """Fraction of the steps after which the gradient is no longer blurred."""
    release_until: Annotated[float, Between(0, 1)] = 0.3
    """Fraction of the steps after which the whole strand is free; before that, only the part nearest the root is."""
    geometry_only: Annotated[float, Between(0, 1)] = 0.3
    """Fraction of the steps during which rendering and alpha losses have no weight (the paper: 1,000 steps)."""
    appearance_blur: Annotated[float, Between(0, 256)] = 3.0
    """Standard deviation, in texels, of the Gaussian that blurs the gradient of the appearance texture at the first
    image step, so that strands seen by few views learn from their neighbours."""
    appearance_blur_until: Annotated[float, Between(0, 1)] = 0.5
    """Fraction of the steps after which that gradient is no longer blurred, and each strand learns on its own."""
    perceptual_from: Annotated[float, Between(0, 1)] = 0.5
    """Fraction of the steps after which the perceptual loss is used; earlier it has little effect for its cost."""
    settled_from: Annotated[float, Between(0, 1)] = 1.0
    """Fraction of the steps after which strands keep their shape, if photographs are close to each other. The colours
    of the places on them are then found once more in closed form, with their changes from view to view; on strands that
    move, they would soon lie elsewhere. Until then, shape steps are as many as they would be in all steps, and the
    schedules of the shape run their whole course."""
    improved_from: Annotated[float, Between(0, 1)] = 0.8
    """Fraction of the steps after which what settled strands still lack in the photographs is found in closed form,
    too. In the remaining steps, the perceptual loss recovers."""
    warmup: Annotated[int, Between(0, 10_000_000)] = 50
    """Steps over which learning rates rise from zero."""
    final_rate: Annotated[float, Between(0, 1)] = 0.1
    """Learning rate at the last step, as a fraction of the first."""


def blur_width(step: int, steps: int, config: ScheduleConfig) -> float:
    """Coarse to fine: standard deviation, in texels, of the blur of the shape texture's gradient."""
    return _falling(config.widest_blur, step, 0, config.blur_until * steps)


def appearance_blur_width(step: int, steps: int, config: ScheduleConfig) -> float:
    """Coarse to fine: standard deviation, in texels, of the blur of the appearance texture's gradient."""
    begin = appearance_begins(steps, config)
    return _falling(config.appearance_blur, step, begin, config.appearance_blur_until * steps)


def released_points(step: int, steps: int, points: int, config: ScheduleConfig) -> int:
    """Root to tip: number of points of each strand, counted from the root, that receive a gradient; from two to all."""
    end = config.release_until * steps
    if step >= end:
        return points
    return min(points, 2 + math.floor((points - 2) * step / end))


def appearance_begins(steps: int, config: ScheduleConfig) -> int:
    """The first step whose rendering and alpha losses count."""
    return math.ceil(config.geometry_only * steps)


def settles(steps: int, config: ScheduleConfig) -> int:
    """The first step from which on strands keep their shape; `steps` if none is."""
    return max(appearance_begins(steps, config), math.ceil(config.settled_from * steps))


def improves(steps: int, config: ScheduleConfig) -> int | None:
    """The step before which the colours of settled strands are improved; None if they are not."""
    step = math.ceil(config.improved_from * steps)
    return step if settles(steps, config) < step < steps else None


def rate_factor(step: int, steps: int, config: ScheduleConfig) -> float:
    """Factor of the learning rates: a short linear rise, then a cosine fall."""
    rise = min(1.0, (step + 1) / max(config.warmup, 1))
    fall = 0.5 * (1 + math.cos(math.pi * min(step / max(steps, 1), 1.0)))
    return rise * (config.final_rate + (1 - config.final_rate) * fall)


def _falling(widest: float, step: int, begin: int, end: float) -> float:
    """Geometric decay from `widest` at `begin` to 1 texel at `end`, then 0."""
    if step >= end or widest <= 0:
        return 0.0
    return widest ** ((end - step) / (end - begin)) if widest > 1 else widest
