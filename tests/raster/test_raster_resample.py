"""Resampling against naive sums, the general operator, and shifts of band-limited images."""

import math

import pytest
import torch
from torch.nn import functional as F

from neural_strands.raster.filters import LowPass
from neural_strands.raster.resample import (
    CLAMP,
    LEAKY_GAIN,
    downsample,
    filtered_leaky_relu,
    leaky_relu,
    upsample,
)

KERNEL = LowPass().coefficients()


def naive_upsample(row: list[float], kernel: list[float], factor: int) -> list[float]:
    """Each input sample adds its scaled kernel, centred according to the areas of the pixels."""
    fine = [0.0] * (len(row) * factor)
    shift = (len(kernel) - factor) // 2
    for i, value in enumerate(row):
        for k, weight in enumerate(kernel):
            if 0 <= i * factor + k - shift < len(fine):
                fine[i * factor + k - shift] += factor * weight * value
    return fine


def naive_downsample(row: list[float], kernel: list[float], factor: int) -> list[float]:
    shift = (len(kernel) - factor) // 2
    return [
        sum(w * row[i * factor + k - shift] for k, w in enumerate(kernel) if 0 <= i * factor + k - shift < len(row))
        for i in range(len(row) // factor)
    ]


def along_rows(function, images: torch.Tensor, *arguments) -> torch.Tensor:
    flat = [function(row.tolist(), KERNEL.tolist(), *arguments) for row in images.reshape(-1, images.shape[-1])]
    return torch.tensor(flat, dtype=images.dtype).reshape(*images.shape[:-1], -1)


@pytest.mark.parametrize(("operator", "naive"), [(upsample, naive_upsample), (downsample, naive_downsample)])
def test_equals_a_naive_sum(operator, naive, generator):
    images = torch.randn(2, 3, 10, 16, generator=generator, dtype=torch.float64)
    wide = along_rows(naive, images, 2)
    expected = along_rows(naive, wide.mT, 2).mT
    torch.testing.assert_close(operator(images, KERNEL), expected, rtol=1e-6, atol=1e-7)


def upfirdn2d(images, kernel, up=1, down=1, padding=(0, 0)):
    """Insert `up - 1` zeros after each sample, pad, convolve in two dimensions, keep every `down`-th sample."""
    batch, channel, height, width = images.shape
    spread = images.new_zeros(batch, channel, height * up, width * up)
    spread[:, :, ::up, ::up] = images
    square = torch.outer(kernel, kernel).to(images).expand(channel, 1, -1, -1)
    return F.conv2d(F.pad(spread, [*padding, *padding]), square, groups=channel)[:, :, ::down, ::down]


def test_fast_paths_equal_the_general_operator_in_values_and_gradients(generator):
    images = torch.randn(2, 4, 12, 20, generator=generator, dtype=torch.float64, requires_grad=True)
    for fast, slow in (
        (upsample(images, KERNEL), upfirdn2d(images, 2 * KERNEL, up=2, padding=(6, 5))),
        (downsample(images, KERNEL), upfirdn2d(images, KERNEL, down=2, padding=(5, 5))),
    ):
        torch.testing.assert_close(fast, slow)
        cotangent = torch.randn(fast.shape, generator=generator, dtype=torch.float64)
        torch.testing.assert_close(
            torch.autograd.grad(fast, images, cotangent)[0], torch.autograd.grad(slow, images, cotangent)[0]
        )


def test_gradients_are_those_of_finite_differences(generator):
    images = torch.randn(1, 2, 4, 6, generator=generator, dtype=torch.float64, requires_grad=True)
    bias = torch.randn(2, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x, b: filtered_leaky_relu(x, b, KERNEL), (images, bias))
    assert torch.autograd.gradcheck(leaky_relu, (images, bias))


def test_constants_and_the_linear_side_pass_unchanged():
    images = torch.full((1, 1, 40, 40), 3.0)
    inner = (..., slice(12, -12), slice(12, -12))
    torch.testing.assert_close(upsample(images, KERNEL)[inner], torch.full_like(upsample(images, KERNEL)[inner], 3.0))
    torch.testing.assert_close(downsample(images, KERNEL)[..., 6:-6, 6:-6], torch.full((1, 1, 8, 8), 3.0))
    activated = filtered_leaky_relu(images, torch.tensor([1.0]), KERNEL)
    torch.testing.assert_close(activated[inner], torch.full_like(activated[inner], 4.0 * LEAKY_GAIN))


def band_limited(shift: float, size: int = 64) -> torch.Tensor:
    """A periodic sum of cosines up to a quarter cycle a pixel, moved right by `shift` pixels."""
    generator = torch.Generator().manual_seed(1)
    x = torch.arange(size, dtype=torch.float64) - shift
    y = torch.arange(size, dtype=torch.float64)[:, None]
    image = torch.zeros(size, size, dtype=torch.float64)
    for _ in range(24):
        u, v = torch.randint(-size // 4, size // 4 + 1, (2,), generator=generator).tolist()
        amplitude, phase = torch.randn(2, generator=generator, dtype=torch.float64).tolist()
        image += amplitude * torch.cos(2 * math.pi * (u * x + v * y) / size + phase)
    return image[None, None]


def shift_fidelity(activation) -> float:
    """Peak signal over the error between activating a moved image and moving the activated image, in decibels."""
    margin = 16
    still, moved = (
        activation(F.pad(band_limited(shift), [margin] * 4, mode="circular"))[0, 0, margin:-margin, margin:-margin]
        for shift in (0.0, 0.5)
    )
    ramp = torch.exp(-2j * math.pi * 0.5 * torch.fft.fftfreq(still.shape[-1], dtype=torch.float64))
    expected = torch.fft.ifft(torch.fft.fft(still) * ramp).real
    return (10 * torch.log10(expected.abs().max() ** 2 / (expected - moved).square().mean())).item()


def test_filtered_activation_moves_with_its_input_and_the_pointwise_one_does_not():
    bias = torch.zeros(1, dtype=torch.float64)
    plain = shift_fidelity(lambda x: leaky_relu(x, bias))
    filtered = shift_fidelity(lambda x: filtered_leaky_relu(x, bias, KERNEL))
    assert filtered > plain + 10, (filtered, plain)


def test_half_precision_neither_overflows_nor_changes_type():
    images = torch.full((1, 2, 16, 16), 300.0, dtype=torch.bfloat16)
    activated = filtered_leaky_relu(images, torch.zeros(2), KERNEL)
    assert activated.dtype == torch.bfloat16
    assert activated.max() == 256


def test_odd_sides_and_lopsided_kernels_are_refused():
    with pytest.raises(ValueError, match="sides that it divides, found 5 x 6"):
        downsample(torch.zeros(1, 1, 5, 6), KERNEL)
    with pytest.raises(ValueError, match="cannot be centred"):
        upsample(torch.zeros(1, 1, 4, 4), torch.ones(5))


def test_round_trip_keeps_a_smooth_image(generator):
    image = F.interpolate(
        torch.randn(1, 1, 8, 8, generator=generator), scale_factor=8, mode="bicubic", align_corners=False
    )
    restored = downsample(upsample(image, KERNEL), KERNEL)
    torch.testing.assert_close(restored[..., 8:-8, 8:-8], image[..., 8:-8, 8:-8], atol=0.03, rtol=0)


@pytest.mark.parametrize(
    ("batch", "channels", "height", "width"),
    [(1, 16, 40, 37), (2, 32, 9, 150), (1, 48, 2, 2), (1, 16, 70, 257), (1, 16, 3, 4), (2, 32, 5, 2)],
)
def test_the_kernel_of_the_cpu_gives_what_torch_gives(generator, batch, channels, height, width):
    """The bias is large, so that wrong borders would show: it does not continue outside the image."""
    images = torch.randn(batch, channels, height, width, generator=generator)
    images = images.contiguous(memory_format=torch.channels_last)
    bias, kernel = 3 * torch.randn(channels, generator=generator), LowPass().coefficients()
    # With a gradient, torch's convolutions do the work.
    expected = filtered_leaky_relu(images.clone().requires_grad_(), bias, kernel).detach()
    threads, found = torch.get_num_threads(), []
    try:
        for count in (1, 3):
            torch.set_num_threads(count)
            found.append(filtered_leaky_relu(images, bias, kernel))
    finally:
        torch.set_num_threads(threads)
    assert torch.equal(found[0], found[1])
    assert found[0].is_contiguous(memory_format=torch.channels_last)
    torch.testing.assert_close(found[0], expected, rtol=2e-6, atol=4e-6)
    assert not torch.equal(found[0], expected)


def test_the_kernel_of_the_cpu_clamps_and_takes_other_layouts(generator):
    images = 1000 * torch.randn(1, 16, 12, 12, generator=generator)
    bias, kernel = torch.zeros(16), LowPass().coefficients()
    found = filtered_leaky_relu(images, bias, kernel)
    expected = filtered_leaky_relu(images.clone().requires_grad_(), bias, kernel).detach()
    assert float(found.abs().max()) == CLAMP
    torch.testing.assert_close(found, expected, rtol=2e-6, atol=1e-3)
