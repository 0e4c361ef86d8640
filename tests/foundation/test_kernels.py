"""Warp kernels over torch tensors: the same values as torch, in one piece or split."""

import pytest
import torch
import warp as wp

from neural_strands.foundation.kernels import SMALLEST_SHARE, array, launch, launch_split


@wp.kernel
def _double(values: wp.array(dtype=wp.float32), result: wp.array(dtype=wp.float32)):
    index = wp.tid()
    result[index] = 2.0 * values[index]


@wp.kernel
def _square(start: int, values: wp.array(dtype=wp.float32), result: wp.array(dtype=wp.float32)):
    index = start + wp.tid()
    result[index] = values[index] * values[index]


def test_launch_fills_the_tensor(device: torch.device, generator: torch.Generator):
    values = torch.rand(100, generator=generator).to(device)
    result = torch.zeros_like(values)
    launch(_double, 100, [array(values), array(result)], device)
    assert torch.equal(result, 2 * values)


def test_launch_of_nothing_is_nothing(device: torch.device):
    launch(_double, 0, [], device)


@pytest.mark.parametrize("count", [1, SMALLEST_SHARE - 1, 5 * SMALLEST_SHARE + 3])
def test_split_launch_covers_every_item(count: int, device: torch.device, generator: torch.Generator):
    values = torch.rand(count, generator=generator).to(device)
    result = torch.full_like(values, -1.0)
    launch_split(_square, count, [array(values), array(result)], device)
    assert torch.equal(result, values * values)


def test_array_shares_memory_and_drops_gradients():
    values = torch.arange(3.0).requires_grad_()
    shared = array(values)
    with torch.no_grad():
        values[1] = 7.0
    assert shared.numpy().tolist() == [0.0, 7.0, 2.0]
    assert not shared.requires_grad
