import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from neural_strands.evaluation.image_metrics import psnr, sharpness, ssim
from neural_strands.evaluation.structural_loss import structural_loss


def images(generator: torch.Generator, height: int = 24, width: int = 31) -> tuple[torch.Tensor, torch.Tensor]:
    first, second = torch.rand(2, height, width, 3, generator=generator, dtype=torch.float64)
    return first, second


def test_psnr_of_a_constant_error():
    reference = torch.full((8, 9, 3), 0.5, dtype=torch.float64)
    # A mean squared error of 0.01 is 20 dB below a range of 1.
    assert psnr(reference + 0.1, reference).item() == pytest.approx(20.0)
    assert psnr(reference, reference).item() == math.inf


def test_psnr_within_a_mask_sees_nothing_outside():
    reference = torch.zeros(10, 10, 3)
    image = reference.clone()
    image[:5] = 0.1
    image[5:] = 1.0
    mask = torch.zeros(10, 10)
    mask[:5] = 1.0
    assert psnr(image, reference, mask).item() == pytest.approx(20.0, abs=1e-4)
    assert psnr(image, reference, torch.zeros(10, 10)).isnan()


def test_ssim_equals_scipys_gaussian_windows(generator):
    a, b = images(generator)

    def blur(x: np.ndarray) -> np.ndarray:
        return gaussian_filter(x, (1.5, 1.5, 0), truncate=5 / 1.5)[5:-5, 5:-5]

    x, y = a.numpy(), b.numpy()
    mean_x, mean_y = blur(x), blur(y)
    variance_x, variance_y = blur(x * x) - mean_x**2, blur(y * y) - mean_y**2
    covariance = blur(x * y) - mean_x * mean_y
    top = (2 * mean_x * mean_y + 1e-4) * (2 * covariance + 9e-4)
    bottom = (mean_x**2 + mean_y**2 + 1e-4) * (variance_x + variance_y + 9e-4)
    assert ssim(a, b).item() == pytest.approx((top / bottom).mean(), rel=1e-9)
    mask = torch.rand(24, 31, generator=generator, dtype=torch.float64)
    weight = mask.numpy()[5:-5, 5:-5]
    expected = ((top / bottom).mean(axis=-1) * weight).sum() / weight.sum()
    assert ssim(a, b, mask).item() == pytest.approx(expected, rel=1e-9)


def test_ssim_of_constants_in_closed_form(generator):
    # Without variance, only the luminance term remains: (2 a b + C1) / (a^2 + b^2 + C1).
    a, b = torch.full((2, 12, 12, 3), 0.4, dtype=torch.float64), torch.full((2, 12, 12, 3), 0.6, dtype=torch.float64)
    assert ssim(a, b).tolist() == pytest.approx([(2 * 0.24 + 1e-4) / (0.16 + 0.36 + 1e-4)] * 2)
    random, _ = images(generator)
    assert ssim(random, random).item() == pytest.approx(1.0)
    with pytest.raises(ValueError, match="11 pixels"):
        ssim(random[:10], random[:10])


def test_structural_loss_is_zero_at_equality_and_orders_shifts(generator):
    smooth = torch.from_numpy(gaussian_filter(np.random.default_rng(0).random((64, 80, 3)), (1, 1, 0)))
    assert structural_loss(smooth, smooth).item() == pytest.approx(0.0, abs=1e-9)
    losses = [structural_loss(smooth.roll(shift, 1), smooth).item() for shift in (1, 2, 4)]
    assert 0 < losses[0] < losses[1] < losses[2]
    assert structural_loss(smooth[:11, :11], smooth[1:12, 1:12]).item() > 0


def test_structural_loss_is_differentiable_and_masked(generator):
    a, b = images(generator)
    a.requires_grad_()
    mask = torch.zeros(24, 31, dtype=torch.float64)
    mask[:, :8] = 1.0
    structural_loss(a, b, mask).backward()
    gradient = a.grad.abs().sum(dim=-1)
    assert gradient[:, :8].min() > 0
    # Windows of 11 pixels at the coarsest octave used (24 -> 12 rows) reach 5 coarse pixels beyond the mask.
    assert gradient[:, 8 + 2 * 6 + 2 :].max() == 0
    empty = structural_loss(b.requires_grad_(), a.detach(), torch.zeros(24, 31, dtype=torch.float64))
    assert empty.item() == 0
    empty.backward()
    assert b.grad is not None
    assert torch.equal(b.grad, torch.zeros_like(b))


def test_structural_loss_agrees_with_finite_differences(generator):
    a, b = images(generator)
    a.requires_grad_()
    structural_loss(a, b).backward()
    step = 1e-7 * torch.randn(24, 31, 3, generator=generator, dtype=torch.float64)
    with torch.no_grad():
        change = structural_loss(a + step, b) - structural_loss(a - step, b)
    assert change.item() == pytest.approx(2 * (a.grad * step).sum().item(), rel=1e-4)


def test_sharpness_is_the_share_of_detail_that_is_left(generator):
    _, reference = images(generator)
    smooth = torch.from_numpy(gaussian_filter(reference.numpy(), (1.0, 1.0, 0)))
    assert sharpness(reference, reference).item() == pytest.approx(1.0)
    assert sharpness(0.3 + 0.25 * reference, reference).item() == pytest.approx(0.25)
    detail = [x - gaussian_filter(x, (1.5, 1.5, 0), truncate=5 / 1.5) for x in (smooth.numpy(), reference.numpy())]
    fine, full = (np.sqrt((each[5:-5, 5:-5] ** 2).mean()) for each in detail)
    assert sharpness(smooth, reference).item() == pytest.approx(fine / full, rel=1e-6)
    assert fine / full < 0.5


def test_sharpness_within_a_mask(generator):
    _, reference = images(generator)
    flat = reference.clone()
    flat[:, :16] = 0.5
    left = torch.zeros(24, 31, dtype=torch.float64)
    left[:, :10] = 1.0
    assert sharpness(flat, reference, left).item() < 0.2
    assert sharpness(flat, reference, left.flip(1)).item() == pytest.approx(1.0)
    with pytest.raises(ValueError, match="11 pixels"):
        sharpness(flat[:10], reference[:10])
