"""Graphs of the image generator compute what it computes, after its weights and its input have changed."""

import pytest
import torch

from neural_strands.model.graphed_unet import OFTEN, GraphedUNet
from neural_strands.model.unet import UNet, UNetConfig

CHANNELS = 5


def generator(device: torch.device) -> UNet:
    config = UNetConfig(widths=(8, 8))
    return UNet(CHANNELS, config, torch.Generator().manual_seed(0)).to(device)


def maps(seed: int, device: torch.device, side: int = 32) -> list[torch.Tensor]:
    random = torch.Generator().manual_seed(seed)
    return [
        torch.randn(1, CHANNELS, side // 2**level, side // 2**level, generator=random).to(device) for level in (0, 1)
    ]


@pytest.mark.gpu
@pytest.mark.parametrize("half", [False, True])
def test_a_picture_is_that_of_the_generator(cuda, half):
    unet = generator(cuda)
    graphed = GraphedUNet(unet)
    with torch.no_grad(), torch.autocast("cuda", torch.bfloat16, enabled=half, cache_enabled=False):
        for call in range(OFTEN + 3):
            for weight in unet.parameters():
                weight.mul_(1.1)
            for side in (32, 48):
                given = maps(call, cuda, side)
                torch.testing.assert_close(graphed(given), unet(given))
    assert len(graphed._graphs) == 2


@pytest.mark.gpu
@pytest.mark.parametrize("half", [False, True])
def test_gradients_are_those_of_the_generator(cuda, half):
    unet = generator(cuda)
    graphed = GraphedUNet(unet)
    graphed.in_turn = True
    for call in range(OFTEN + 3):
        with torch.no_grad():
            for weight in unet.parameters():
                weight.mul_(1.1)
        found = []
        for run in (graphed, unet):
            given = [each.requires_grad_() for each in maps(call, cuda)]
            unet.zero_grad()
            with torch.autocast("cuda", torch.bfloat16, enabled=half, cache_enabled=False):
                picture = run(given)
            picture.square().sum().backward()
            found.append([picture, *(each.grad.clone() for each in (*given, *unet.parameters()))])
        for ours, theirs in zip(*found, strict=True):
            torch.testing.assert_close(ours, theirs, atol=1e-3, rtol=1e-3)
    assert len(graphed._graphs) == 1


def test_without_a_gpu_there_are_no_graphs():
    unet = generator(torch.device("cpu"))
    graphed = GraphedUNet(unet)
    for call in range(OFTEN + 1):
        given = maps(call, torch.device("cpu"))
        assert torch.equal(graphed(given), unet(given))
    assert not graphed._graphs
