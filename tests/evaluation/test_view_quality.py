"""Quality of views: compared with the metrics over each region, numpy for the alpha map, and means by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from neural_strands.evaluation.flip import flip
from neural_strands.evaluation.image_metrics import psnr, sharpness, ssim
from neural_strands.evaluation.lpips import Lpips
from neural_strands.evaluation.lpips_trunks import LAYOUTS, build_trunk
from neural_strands.evaluation.view_quality import (
    HEADS,
    AlphaQuality,
    ImageQuality,
    Quality,
    RenderedView,
    ViewQuality,
    alpha_quality,
    mean_quality,
    view_qualities,
)


def rendered_view(generator: torch.Generator, name: str = "front") -> RenderedView:
    """Two pictures of noise, with hair in a rectangle."""
    mask = torch.zeros(40, 40)
    mask[10:30, 5:25] = 1.0
    rendered, photograph = torch.rand(2, 40, 40, 3, generator=generator)
    return RenderedView(name, rendered, photograph, mask, torch.rand(40, 40, generator=generator))


def test_each_view_is_judged_in_its_hair_region_and_as_a_whole(generator):
    view = rendered_view(generator)
    (found,) = view_qualities([view], None)
    assert found.view.name == "front"
    hair, image = found.quality.hair, found.quality.image
    assert hair is not None
    assert hair.lpips is image.lpips is None
    assert hair.psnr == float(psnr(view.rendered, view.photograph, view.mask))
    assert hair.ssim == float(ssim(view.rendered, view.photograph, view.mask))
    assert hair.flip == flip(view.rendered, view.photograph, view.mask)
    assert hair.sharpness == float(sharpness(view.rendered, view.photograph, view.mask))
    assert image.psnr == float(psnr(view.rendered, view.photograph))
    assert image.ssim == float(ssim(view.rendered, view.photograph))
    outside = torch.where(view.mask[..., None] > 0, view.photograph, 0.0)
    (again,) = view_qualities([replace(view, photograph=outside)], None)
    assert again.quality.hair is not None
    assert again.quality.hair.psnr == hair.psnr
    assert again.quality.image.psnr != image.psnr


def test_lpips_is_asked_about_both_regions(generator):
    view, network = rendered_view(generator), "squeeze"
    heads = [torch.rand(channels, generator=generator) for channels in LAYOUTS[network].channels]
    metric = Lpips(network, build_trunk(network).state_dict(), heads)
    (found,) = view_qualities([view], metric)
    assert found.quality.hair is not None
    assert found.quality.hair.lpips == float(metric(view.rendered, view.photograph, view.mask))
    assert found.quality.image.lpips == float(metric(view.rendered, view.photograph))
    assert found.quality.hair.lpips != found.quality.image.lpips


def test_without_a_mask_hair_is_where_the_renderer_shows_it(generator):
    view = replace(rendered_view(generator), mask=None)
    (found,) = view_qualities([view], None)
    assert found.quality.hair is not None
    assert found.quality.hair.psnr == float(psnr(view.rendered, view.photograph, (view.alpha >= 0.5).float()))
    assert found.quality.alpha is None
    with pytest.raises(ValueError, match="front has neither"):
        view_qualities([replace(view, alpha=None)], None)


def test_a_view_without_hair_is_judged_as_a_whole_alone(generator):
    view = rendered_view(generator)
    bald = replace(view, mask=torch.zeros(40, 40))
    qualities = view_qualities([view, bald], None)
    assert qualities[1].quality.hair is None
    assert mean_quality(qualities).hair == qualities[0].quality.hair


def test_alpha_is_held_against_the_mask(generator):
    alpha, mask = torch.rand(2, 12, 9, generator=generator)
    found = alpha_quality(alpha, mask)
    a, m = alpha.numpy(), mask.numpy()
    assert found.mean_absolute_error == pytest.approx(np.abs(a - m).mean(), rel=1e-5)
    shown, true = {tuple(p) for p in np.argwhere(a >= 0.5)}, {tuple(p) for p in np.argwhere(m >= 0.5)}
    assert found.outline_iou == pytest.approx(len(shown & true) / len(shown | true))
    nothing = torch.zeros(4, 4)
    assert alpha_quality(nothing, nothing) == AlphaQuality(0.0, 1.0)
    assert alpha_quality(nothing, nothing + 1) == AlphaQuality(1.0, 0.0)


def test_means_are_over_the_views_that_have_a_figure(generator):
    view = rendered_view(generator)
    whole = ImageQuality(20.0, 0.4, None, 0.1, 0.5)
    one = Quality(ImageQuality(10.0, 0.2, 0.5, 0.3, 0.9), whole, AlphaQuality(0.1, 0.8))
    other = Quality(None, ImageQuality(30.0, 0.6, None, 0.3, 1.5), AlphaQuality(0.3, 0.4))
    mean = mean_quality([ViewQuality(view, one), ViewQuality(view, other)])
    assert mean.hair == one.hair
    assert mean.image == ImageQuality(25.0, 0.5, None, 0.2, 1.0)
    assert mean.alpha is not None
    assert mean.alpha.mean_absolute_error == pytest.approx(0.2)
    assert mean.alpha.outline_iou == pytest.approx(0.6)
    assert len(mean.cells()) == len(HEADS)
    assert other.cells() == (*"-----", "30.00", "0.6000", "-", "0.3000", "1.5000", "0.3000", "0.4000")
    assert other.as_dict()["hair"] is None
    assert one.as_dict()["hair"] == {"psnr": 10.0, "ssim": 0.2, "lpips": 0.5, "flip": 0.3, "sharpness": 0.9}


def test_equal_images_have_an_infinite_psnr(generator):
    view = rendered_view(generator)
    (found,) = view_qualities([replace(view, rendered=view.photograph)], None)
    assert math.isinf(found.quality.image.psnr)
    assert found.quality.image.ssim == pytest.approx(1.0)
