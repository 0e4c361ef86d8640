"""Synthetic curves: lengths, spacing, repeatability, and the shapes they are made of."""

from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.curves import CurveConfig, augment, synthetic_curves
from neural_strands.prior.traversal import measure


def drawn(count: int = 200, seed: int = 0, **changes: float) -> torch.Tensor:
    return synthetic_curves(count, torch.Generator().manual_seed(seed), replace(CurveConfig(), **changes))


def test_curves_start_at_the_root_and_are_spaced_evenly() -> None:
    curves = drawn()
    assert torch.isfinite(curves).all()
    assert curves[:, 0].abs().max() == 0
    step = segments(curves).norm(dim=-1)
    assert (step.std(dim=1) / step.mean(dim=1)).median() < 1e-3


def test_lengths_cover_the_range_and_stay_within_it() -> None:
    length = lengths(drawn(600))
    assert length.min() >= 0.01 * 0.999
    assert length.max() <= 0.60 * 1.001
    assert length.quantile(0.1) < 0.02
    assert length.quantile(0.9) > 0.3


def test_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    assert torch.equal(drawn(seed=3), drawn(seed=3))
    assert not torch.equal(drawn(seed=3), drawn(seed=4))


def test_coils_are_curlier_than_waves_and_waves_than_smooth_hair() -> None:
    smooth = measure(drawn(smooth=1.0, wavy=0.0))[:, 1].mean()
    wavy = measure(drawn(smooth=0.0, wavy=1.0))[:, 1].mean()
    coiled = measure(drawn(smooth=0.0, wavy=0.0))[:, 1].mean()
    assert smooth < wavy < coiled


def test_turns_do_not_exceed_what_the_points_can_show() -> None:
    curves = drawn(smooth=0.0, wavy=0.0, most_turns=5.0)
    # A round coil of n turns has its strongest frequency at n cycles per strand.
    spectrum = torch.fft.rfft(
        segments(curves)[..., 0] - segments(curves)[..., 0].mean(dim=1, keepdim=True), dim=1
    ).abs()
    assert spectrum[:, 9:].square().sum() < 0.1 * spectrum.square().sum()


def test_augmentation_without_stretch_is_a_rigid_motion_that_keeps_the_normal(generator: torch.Generator) -> None:
    curves = drawn(20)
    moved = augment(curves, generator, stretch=0.0)
    torch.testing.assert_close(lengths(moved), lengths(curves))
    torch.testing.assert_close(moved[..., 2], curves[..., 2])
    assert (moved - curves).abs().max() > 1e-3


def test_augmentation_stretches_each_axis_within_bounds(generator: torch.Generator) -> None:
    curves = drawn(50)
    ratio = augment(curves, generator, stretch=0.25)[:, -1, 2] / curves[:, -1, 2]
    assert ratio.min() >= 0.75 - 1e-5
    assert ratio.max() <= 1.25 + 1e-5
    assert ratio.std() > 0.05


@pytest.mark.parametrize("points", [2, 25, 400])
def test_any_number_of_points(points: int) -> None:
    curves = synthetic_curves(3, torch.Generator().manual_seed(0), points=points)
    assert curves.shape == (3, points, 3)
