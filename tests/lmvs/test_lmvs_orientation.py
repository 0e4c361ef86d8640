"""Orientation of gratings and single lines of known angle."""

import math

import pytest
import torch

from neural_strands.lmvs.orientation import OrientationConfig, angle_difference, luma, orientation_map

CONFIG = OrientationConfig()
ANGLES = [math.radians(7.3 * k + 1.1) for k in range(24)]


def coordinates(size: int) -> tuple[torch.Tensor, torch.Tensor]:
    steps = torch.arange(size, dtype=torch.float32) + 0.5 - size / 2
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    return x, y


def grating(angle: float, period: float = 4.0, size: int = 64) -> torch.Tensor:
    x, y = coordinates(size)
    return 0.5 + 0.4 * torch.cos(2 * math.pi * (y * math.cos(angle) - x * math.sin(angle)) / period)


def line(angle: float, width: float = 1.0, size: int = 64) -> torch.Tensor:
    # An anti-aliased line through the middle: the pixel's share of a strip, to first order.
    x, y = coordinates(size)
    distance = (y * math.cos(angle) - x * math.sin(angle) - 0.2).abs()
    return (width / 2 + 0.5 - distance).clamp(0, min(width, 1.0))


def degrees_off(image: torch.Tensor, angle: float, window: int = 8) -> torch.Tensor:
    seen = orientation_map(image, CONFIG)
    middle = slice(image.shape[0] // 2 - window, image.shape[0] // 2 + window)
    return torch.rad2deg(angle_difference(seen.angle[middle, middle], torch.full((2 * window, 2 * window), angle)))


def test_gratings_of_every_angle():
    error = torch.stack([degrees_off(grating(angle), angle).mean() for angle in ANGLES])
    assert error.mean() < 0.5


def test_single_lines_of_every_angle():
    error = torch.stack([degrees_off(line(angle), angle, window=1).mean() for angle in ANGLES])
    assert error.mean() < 0.5


def test_noise_is_borne_gracefully(generator: torch.Generator):
    means = []
    for noise in (0.0, 0.1, 0.2, 0.4):
        error = [
            degrees_off(grating(angle) + noise * torch.randn(64, 64, generator=generator), angle).mean()
            for angle in ANGLES[::6]
        ]
        means.append(float(torch.stack(error).mean()))
    assert means[1] < 2
    assert means[2] < 4
    assert means[3] < 15


def test_confidence_falls_with_noise_and_is_zero_without_texture(generator: torch.Generator):
    clean = orientation_map(grating(0.4), CONFIG).confidence
    noisy = orientation_map(0.5 + 0.2 * torch.randn(64, 64, generator=generator), CONFIG).confidence
    flat = orientation_map(torch.full((64, 64), 0.5), CONFIG).confidence
    assert clean[32, 32] > 0.8
    assert noisy.mean() < 0.5
    assert flat.max() == 0
    for confidence in (clean, noisy):
        assert confidence.min() >= 0
        assert confidence.max() <= 1


def test_turning_the_picture_turns_the_angle():
    image = grating(0.3) + 0.1 * line(0.3)
    angle = orientation_map(image, CONFIG).angle[24:40, 24:40]
    # Rows become columns: x and y change places, and the angle is mirrored at the diagonal.
    turned = orientation_map(image.T.contiguous(), CONFIG).angle[24:40, 24:40].T
    assert angle_difference(turned, math.pi / 2 - angle).max() < math.radians(0.5)


def test_several_scales_still_find_the_angle():
    config = OrientationConfig(scales=(1.0, 2.0))
    seen = orientation_map(grating(1.0, period=8.0), config)
    assert angle_difference(seen.angle[32, 32], torch.tensor(1.0)) < math.radians(1)


@pytest.mark.parametrize(("first", "second", "expected"), [(0.1, math.pi - 0.1, 0.2), (0.0, math.pi / 2, math.pi / 2)])
def test_angles_are_a_half_turn_apart_at_most(first: float, second: float, expected: float):
    found = angle_difference(torch.tensor(first), torch.tensor(second))
    assert found == pytest.approx(expected, abs=1e-6)


def test_luma_of_grey_is_grey():
    assert torch.allclose(luma(torch.full((2, 3, 3), 0.7)), torch.full((2, 3), 0.7))
