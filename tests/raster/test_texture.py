import math

import numpy as np
import pytest
import scipy.special
import torch

from neural_strands.raster.texture import blur_texture, sample_bilinear, sample_picture, sample_texture


def sample(texture, uv, blur=0.0):
    return sample_texture(texture, uv, blur)


def test_agrees_with_grid_sample(generator, device):
    texture = torch.randn(6, 9, 4, generator=generator).to(device).requires_grad_()
    uv = (torch.rand(200, 2, generator=generator) * 1.4 - 0.2).to(device).requires_grad_()
    ours = sample(texture, uv)
    theirs = torch.nn.functional.grid_sample(
        texture.permute(2, 0, 1)[None], (2 * uv - 1)[None, None], padding_mode="border", align_corners=False
    )[0, :, 0].T
    torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-5)
    cotangent = torch.randn(ours.shape, generator=generator).to(device)
    for found, expected in zip(
        torch.autograd.grad(ours, [texture, uv], cotangent),
        torch.autograd.grad(theirs, [texture, uv], cotangent),
        strict=True,
    ):
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-4)


def test_both_ways_to_sample_agree(generator, device):
    texture = torch.rand(7, 5, 3, generator=generator).to(device).requires_grad_()
    uv = (1.4 * torch.rand(300, 2, generator=generator) - 0.2).to(device).requires_grad_()
    upstream = torch.rand(300, 3, generator=generator).to(device)
    found = []
    for sample in (sample_bilinear, sample_picture):
        colour = sample(texture, uv)
        found.append((colour, *torch.autograd.grad((colour * upstream).sum(), (texture, uv))))
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=1e-4)
    assert sample_picture(texture, uv[:0]).shape == (0, 3)


def test_texel_centres_return_their_texels(generator):
    texture = torch.randn(4, 5, 3, generator=generator)
    rows, columns = torch.meshgrid(torch.arange(4), torch.arange(5), indexing="ij")
    uv = torch.stack([(columns + 0.5) / 5, (rows + 0.5) / 4], dim=-1).view(-1, 2)
    torch.testing.assert_close(sample(texture, uv), texture.view(-1, 3))


def test_gradcheck(generator):
    texture = torch.randn(5, 4, 2, generator=generator, dtype=torch.float64).requires_grad_()
    uv = torch.rand(7, 2, generator=generator, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(sample, (texture, uv))


@pytest.mark.parametrize("sigma", [0.7, 3.0, 11.0])
def test_backward_is_the_plain_gradient_blurred(generator, device, sigma):
    height, width = 24, 20
    texture = torch.randn(height, width, 3, generator=generator).to(device).requires_grad_()
    uv = torch.rand(50, 2, generator=generator).to(device)
    cotangent = torch.randn(50, 3, generator=generator).to(device)
    torch.testing.assert_close(sample(texture, uv, sigma), sample(texture, uv))
    (blurred,) = torch.autograd.grad(sample(texture, uv, sigma), texture, cotangent)
    (plain,) = torch.autograd.grad(sample(texture, uv), texture, cotangent)
    torch.testing.assert_close(blurred.cpu(), naive_blur(plain.cpu(), sigma), rtol=1e-3, atol=1e-4)


def naive_blur(image, sigma):
    """The taps of the discrete Gaussian over an image that is mirrored at its borders as often as needed."""
    radius = math.ceil(8 * sigma) + 2
    taps = torch.from_numpy(scipy.special.ive(abs(np.arange(-radius, radius + 1)), sigma**2))
    for axis in (0, 1):
        count = image.shape[axis]
        index = (torch.arange(-radius, count + radius)) % (2 * count)
        index = torch.where(index < count, index, 2 * count - 1 - index)
        padded = image.double().index_select(axis, index).movedim(axis, -1)
        image = (padded.unfold(-1, 2 * radius + 1, 1) * taps).sum(-1).movedim(-1, axis)
    return image.float()


@pytest.mark.parametrize("sigma", [0.3, 2.0, 32.0])
def test_blur_keeps_sums_and_constants(generator, sigma):
    image = torch.randn(40, 33, 2, generator=generator)
    blurred = blur_texture(image, sigma)
    torch.testing.assert_close(blurred.sum((0, 1)), image.sum((0, 1)), rtol=1e-4, atol=1e-2)
    torch.testing.assert_close(blur_texture(torch.ones(40, 33, 1), sigma), torch.ones(40, 33, 1), rtol=1e-5, atol=1e-5)


def test_no_points():
    assert sample(torch.zeros(4, 4, 3), torch.zeros(0, 2)).shape == (0, 3)
