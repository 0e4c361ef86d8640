"""Photographs in which noise hides the streaks of the hair.

Noise has energy in all directions, so the window of a few pixels over which the orientation is averaged finds some
direction even in pure noise. In a wide window that direction vanishes and the streaks stay. But a wide window also
averages curls and waves away, so it is for straight hair only.
"""

import statistics
from dataclasses import dataclass
from typing import Annotated

from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.geometry.views import Views
from neural_strands.lmvs.orientation import OrientationConfig, luma, orientation_map

NOISY = 0.1
"""Hair whose orientation has a lower median confidence is noisy; pure noise has 0.07 with the default filters."""
HAIR = 0.5
"""Coverage above which a pixel is hair."""


@dataclass(frozen=True)
class NoiseConfig:
    """When photographs count as noisy, and how straight hair is seen in them."""

    confidence: Annotated[float, Between(0, 1)] = NOISY
    """Photographs whose hair has a lower median confidence of orientation are noisy."""
    window: Annotated[float, Between(0, 100)] = 12.0
    """Standard deviation, in pixels, of the window over which the orientation is averaged in them."""
    views: Annotated[int, Between(1, 1000)] = 8
    """Largest number of photographs that are looked at."""


def noisy(views: Views, orientation: OrientationConfig, config: NoiseConfig) -> bool:
    """Whether noise hides the streaks of the hair in at least half of the photographs; false without hair masks.

    Args:
        views: the photographs.
        orientation: the filters whose confidence is compared.
        config: the limit.
    """
    masked = [index for index, known in enumerate(views.has_hair_mask) if known]
    every = max(1, len(masked) // config.views)
    found = [
        clearness(luma(views.image(index)), mask, orientation)
        for index in masked[::every][: config.views]
        if (mask := views.hair_mask(index)) is not None
    ]
    known = [each for each in found if each is not None]
    return bool(known) and statistics.median_low(known) < config.confidence


def clearness(
    brightness: Float[Tensor, "height width"], mask: Float[Tensor, "height width"], orientation: OrientationConfig
) -> float | None:
    """Median confidence of the hair's orientation in a picture; None without hair.

    Args:
        brightness: the picture.
        mask: coverage of hair.
        orientation: the filters.
    """
    hair = mask > HAIR
    return float(orientation_map(brightness, orientation).confidence[hair].median()) if bool(hair.any()) else None
