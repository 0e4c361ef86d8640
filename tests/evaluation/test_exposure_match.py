"""PSNR of hair at the photograph's exposure, which is estimated from pixels that are not scored."""

import pytest
import torch

from neural_strands.evaluation.exposure_match import FEWEST_PIXELS, matched_psnr, matching_gain, mean_matched_psnr
from neural_strands.evaluation.image_metrics import psnr
from neural_strands.evaluation.view_quality import RenderedView
from neural_strands.foundation.srgb import to_linear, to_srgb

MASK = torch.zeros(32, 32)
MASK[8:20, 8:20] = 1.0
EVERYWHERE = torch.ones(32, 32, dtype=torch.bool)


def rendering() -> torch.Tensor:
    return 0.2 + 0.4 * torch.rand(32, 32, 3, generator=torch.Generator().manual_seed(0))


def exposed(picture: torch.Tensor, *gain: float) -> torch.Tensor:
    return to_srgb(to_linear(picture) * torch.tensor(gain))


def test_exposure_alone_costs_nothing():
    photograph = exposed(rendering(), 1.3, 1.2, 1.1)
    view = RenderedView("view", rendering(), photograph, MASK)
    assert float(psnr(view.rendered, photograph, MASK)) < 30
    found = matched_psnr(view)
    assert found is not None
    assert found > 60


def test_wrong_hair_stays_wrong():
    photograph = rendering()
    photograph[MASK > 0.5] *= 1.3
    view = RenderedView("view", rendering(), photograph, MASK)
    assert matched_psnr(view) == pytest.approx(float(psnr(view.rendered, photograph, MASK)), abs=1e-3)


def test_views_that_tell_nothing_are_left_out():
    bald = RenderedView("bald", rendering(), rendering(), torch.zeros(32, 32))
    unmasked = RenderedView("unmasked", rendering(), rendering(), None, MASK)
    view = RenderedView("view", rendering(), 0.9 * rendering(), MASK)
    assert matched_psnr(bald) is None
    assert matched_psnr(unmasked) is None
    assert mean_matched_psnr([bald, view, unmasked]) == matched_psnr(view)
    assert mean_matched_psnr([bald]) is None


def test_a_gain_is_told_by_its_region_alone():
    photograph = exposed(rendering(), 1.5, 1.0, 0.7)
    photograph[16:] = 0.1
    region = EVERYWHERE.clone()
    region[16:] = False
    torch.testing.assert_close(matching_gain(rendering(), photograph, region), torch.tensor([1.5, 1.0, 0.7]))


def test_clipped_pixels_do_not_count_and_too_few_tell_nothing():
    photograph = exposed(rendering(), 1.5, 1.5, 1.5)
    photograph[:4] = 1.0
    torch.testing.assert_close(matching_gain(rendering(), photograph, EVERYWHERE), torch.full((3,), 1.5))
    few = torch.zeros(32, 32, dtype=torch.bool)
    few.view(-1)[200 : 200 + FEWEST_PIXELS - 1] = True
    torch.testing.assert_close(matching_gain(rendering(), photograph, few), torch.ones(3))
