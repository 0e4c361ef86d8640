"""Photographs of a grating, clear and buried in noise."""

import math

import pytest
import torch
from tiny_capture import cameras

from neural_strands.fitting.noise import NoiseConfig, noisy
from neural_strands.geometry.views import Views
from neural_strands.lmvs.orientation import OrientationConfig

SIDE = 96
CLEAR, BURIED = 0.4, 0.01


def photographs(contrasts: list[float], masked: bool = True) -> Views:
    """A grating of each contrast in noise of 0.1, all of it hair."""
    random = torch.Generator().manual_seed(0)
    x = torch.arange(SIDE, dtype=torch.float32).expand(SIDE, SIDE)
    images = [
        (0.5 + contrast * torch.cos(2 * math.pi * x / 4) + 0.1 * torch.randn(SIDE, SIDE, generator=random))[..., None]
        .clamp(0, 1)
        .expand(-1, -1, 3)
        for contrast in contrasts
    ]
    parts = {"image": images, "hair_mask": len(images) * [torch.ones(SIDE, SIDE) if masked else None]}
    seen = tuple(camera.resized(SIDE, SIDE) for camera in cameras(len(images)))
    return Views(seen, (masked,) * len(images), lambda index, part: parts[part][index])


@pytest.mark.parametrize(
    ("contrasts", "expected"),
    [
        (3 * [CLEAR], False),
        (3 * [BURIED], True),
        ([CLEAR, BURIED, CLEAR], False),
        ([BURIED, CLEAR, BURIED], True),
    ],
)
def test_most_photographs_decide(contrasts: list[float], expected: bool):
    assert noisy(photographs(contrasts), OrientationConfig(), NoiseConfig()) is expected


def test_without_masks_nothing_is_noisy():
    assert not noisy(photographs(3 * [BURIED], masked=False), OrientationConfig(), NoiseConfig())


def test_a_limit_of_zero_never_calls_photographs_noisy():
    assert not noisy(photographs(3 * [BURIED]), OrientationConfig(), NoiseConfig(confidence=0.0))
