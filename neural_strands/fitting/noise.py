"""Photographs in which noise hides the streaks of the hair.

Noise has energy in all directions, so the window of a few pixels over which the orientation is averaged finds some
direction even in pure noise. In a wide window that direction vanishes and the streaks stay. But a wide window also
averages curls and waves away, so it is for straight hair only.
"""

from dataclasses import dataclass
from typing import Annotated

import torch

from neural_strands.foundation.configs import Between
from neural_strands.geometry.views import Views
from neural_strands.lmvs.features import view_features
from neural_strands.lmvs.orientation import OrientationConfig


@dataclass(frozen=True)
class NoiseConfig:
    """When photographs count as noisy, and how straight hair is seen in them."""

    confidence: Annotated[float, Between(0, 1)] = 0.1
    """Photographs whose hair has a lower median confidence of orientation are noisy; pure noise has 0.07."""
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
    found = []
    for index in masked[::every][: config.views]:
        mask = views.hair_mask(index)
        features, seen = view_features(views.cameras[index], views.image(index), mask, orientation)
        if bool(features.hair.any()):
            found.append(seen.confidence[features.hair].median())
    return bool(found) and float(torch.stack(found).median()) < config.confidence
