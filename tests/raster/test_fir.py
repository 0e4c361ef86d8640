"""Filters along an axis agree with their definition and with torch's convolutions, in values and in gradients."""

import pytest
import torch
from torch.nn import functional as F

from neural_strands.raster.fir import Filter, activated_at_twice, filtered

LAYOUTS = (torch.contiguous_format, torch.channels_last)


def by_definition(values: torch.Tensor, by: Filter, axis: int, length: int) -> torch.Tensor:
    """Output i is the sum over inputs j of taps[j * up - i * down + pad] * input[j]."""
    taps = by.taps.flip(0) if by.mirrored else by.taps
    matrix = torch.zeros(length, values.shape[axis])
    for i in range(length):
        for j in range(values.shape[axis]):
            place = j * by.up - i * by.down + by.pad
            if 0 <= place < len(taps):
                matrix[i, j] = by.gain * taps[place]
    return (values.movedim(axis, -1) @ matrix.to(values).T).movedim(-1, axis)


def gradient(picture: torch.Tensor, given: torch.Tensor) -> torch.Tensor:
    """Of a product that weights every output differently."""
    weights = torch.linspace(-1, 1, picture.numel()).view(picture.shape).to(picture)
    return torch.autograd.grad((picture * weights).sum(), given)[0]


@pytest.mark.parametrize("axis", [0, 1, 2, -1])
@pytest.mark.parametrize(("up", "down", "pad"), [(1, 1, 0), (2, 1, 3), (1, 2, 2), (3, 2, -1)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_it_is_its_definition(generator, device, axis, up, down, pad, mirrored):
    given = torch.randn(5, 7, 6, generator=generator)
    taps = torch.randn(5, generator=generator)
    there = given.to(device).requires_grad_()
    found = filtered(there, Filter(taps.to(device), up, down, pad, 1.5, mirrored), axis, 9)
    here = given.double().requires_grad_()
    expected = by_definition(here, Filter(taps, up, down, pad, 1.5, mirrored), axis, 9)
    torch.testing.assert_close(found.detach().cpu().double(), expected.detach(), atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(gradient(found, there).cpu().double(), gradient(expected, here), atol=1e-5, rtol=1e-5)


def activated(images: torch.Tensor, taps: torch.Tensor) -> torch.Tensor:
    """Up, leaky ReLU and down by torch's convolutions."""
    channels, pad = images.shape[1], (len(taps) - 2) // 2
    across = taps.repeat(channels, 1).view(channels, 1, 1, -1)
    down = across.mT
    fine = F.conv_transpose2d(images, 2 * down, stride=(2, 1), padding=(pad, 0), groups=channels)
    fine = F.conv_transpose2d(fine, 2 * across, stride=(1, 2), padding=(0, pad), groups=channels)
    fine = F.leaky_relu(fine, 0.2)
    narrow = F.conv2d(fine, across, stride=(1, 2), padding=(0, pad), groups=channels)
    return 1.4 * F.conv2d(narrow, down, stride=(2, 1), padding=(pad, 0), groups=channels)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_activation_at_twice_the_resolution_is_that_of_convolutions(generator, device, layout):
    given = torch.randn(2, 8, 9, 12, generator=generator).contiguous(memory_format=layout)
    taps = torch.rand(12, generator=generator)
    taps = (taps + taps.flip(0)) / taps.sum() / 2
    there, here = given.to(device).requires_grad_(), given.double().requires_grad_()
    found, expected = activated_at_twice(there, taps.to(device), 5, 0.2, 1.4), activated(here, taps.double())
    torch.testing.assert_close(found.detach().cpu().double(), expected.detach(), atol=1e-5, rtol=1e-5)
    torch.testing.assert_close(gradient(found, there).cpu().double(), gradient(expected, here), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("channels", [8, 6, 3])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_bfloat16_is_rounded_once(generator, device, layout, channels):
    # Rows of three or six channels do not divide into fours.
    given = torch.randn(2, channels, 5, 7, generator=generator).bfloat16().contiguous(memory_format=layout)
    by = Filter(torch.randn(5, generator=generator), up=2, pad=3)
    for axis in (2, 3):
        exact = filtered(given.float(), by, axis, 8)
        found = filtered(given.to(device), Filter(by.taps.to(device), up=2, pad=3), axis, 8).cpu()
        assert found.dtype == torch.bfloat16
        torch.testing.assert_close(found.float(), exact.bfloat16().float(), atol=0, rtol=0.01)
        assert (found == exact.bfloat16()).float().mean() > 0.99


def test_the_gradient_in_bfloat16_passes_the_activation(generator, device):
    given = torch.randn(1, 8, 6, 6, generator=generator).contiguous(memory_format=torch.channels_last)
    taps = torch.full((12,), 1 / 12)
    there, here = given.to(device).bfloat16().requires_grad_(), given.bfloat16().double().requires_grad_()
    found, expected = activated_at_twice(there, taps.to(device), 5, 0.2, 1.4), activated(here, taps.double())
    torch.testing.assert_close(gradient(found, there).cpu().double(), gradient(expected, here), atol=0.05, rtol=0.05)
    # Gradients of some of the channels, as of a concatenation.
    wide = torch.randn(1, 16, 6, 6, generator=generator).to(device).contiguous(memory_format=torch.channels_last)
    part, whole = wide[:, 4:12], wide[:, 4:12].contiguous()
    ours = torch.autograd.grad(activated_at_twice(there.float(), taps.to(device), 5, 0.2, 1.4), there, part)[0]
    theirs = torch.autograd.grad(activated_at_twice(there.float(), taps.to(device), 5, 0.2, 1.4), there, whole)[0]
    torch.testing.assert_close(ours.cpu(), theirs.cpu(), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("kind", [torch.float64, torch.float16])
def test_other_types_come_back_as_they_were(generator, device, kind):
    given, taps = torch.randn(3, 7, generator=generator).to(kind), torch.randn(3, generator=generator).to(kind)
    found = filtered(given.to(device), Filter(taps.to(device), pad=1), 1, 7).cpu()
    assert found.dtype == kind
    expected = by_definition(given.float(), Filter(taps.float(), pad=1), 1, 7)
    torch.testing.assert_close(found.float(), expected, atol=5e-3 if kind == torch.float16 else 1e-5, rtol=1e-3)
