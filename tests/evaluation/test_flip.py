"""FLIP: its definition for plain colours, computed by hand, and the effect of a mask."""

import math

import numpy as np
import pytest
import torch

from neural_strands.evaluation.flip import flip
from neural_strands.foundation.srgb import to_linear

TO_XYZ = np.array(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)


def lab(colour: list[float]) -> np.ndarray:
    """CIE L*a*b* of an sRGB colour, chroma scaled with lightness (the Hunt effect)."""
    xyz = TO_XYZ @ to_linear(torch.tensor(colour, dtype=torch.float64)).numpy() / TO_XYZ.sum(axis=1)
    cube = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    lightness = 116 * cube[1] - 16
    return np.array([lightness, 5 * lightness * (cube[0] - cube[1]), 2 * lightness * (cube[1] - cube[2])])


def plain_difference(one: list[float], other: list[float]) -> float:
    """FLIP of two images of one colour each, which have no edges (Andersson et al. 2020, section 4)."""

    def distance(a: np.ndarray, b: np.ndarray) -> float:
        return (abs(a[0] - b[0]) + math.hypot(a[1] - b[1], a[2] - b[2])) ** 0.7

    largest = distance(lab([0.0, 1.0, 0.0]), lab([0.0, 0.0, 1.0]))
    found, knee = distance(lab(one), lab(other)), 0.4 * largest
    return 0.95 * found / knee if found < knee else 0.95 + 0.05 * (found - knee) / (largest - knee)


def plain(colour: list[float]) -> torch.Tensor:
    return torch.tensor(colour).expand(40, 48, 3)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([0.2, 0.2, 0.2], [0.3, 0.3, 0.3]),
        ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        ([0.3, 0.2, 0.1], [0.35, 0.25, 0.2]),
        ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
    ],
)
def test_plain_colours_differ_as_defined(one, other):
    assert flip(plain(one), plain(other)) == pytest.approx(plain_difference(one, other), abs=2e-3)


def test_equal_images_do_not_differ_and_a_mask_chooses_the_pixels(generator):
    image = torch.rand(40, 48, 3, generator=generator)
    assert flip(image, image) == pytest.approx(0.0, abs=1e-6)
    half = torch.cat([image[:, :24], 1 - image[:, 24:]], dim=1)
    left = torch.zeros(40, 48)
    left[:, :10] = 1.0
    assert flip(half, image, left) < 0.05 < flip(half, image, 1 - left)
    assert math.isnan(flip(half, image, torch.zeros(40, 48)))
