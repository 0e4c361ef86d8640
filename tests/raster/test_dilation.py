"""Dilation by a disc agrees with the distance to the mask."""

import pytest
import torch

from neural_strands.raster.dilation import dilate


def disc(radius, side=101):
    offset = torch.arange(side) - side // 2
    return (offset[:, None].square() + offset.square()).sqrt() <= radius


def test_dilating_a_disc_gives_a_larger_disc():
    grown = dilate(disc(20), 6)
    assert grown[disc(25)].all()
    assert not grown[~disc(27)].any()
    assert torch.equal(dilate(disc(20), 0), disc(20))


@pytest.mark.parametrize("radius", [1, 2, 6, 40])
def test_pixels_within_the_radius_are_covered(generator, device, radius):
    mask = torch.rand(37, 52, generator=generator) < 0.005
    rows, columns = torch.meshgrid(torch.arange(37), torch.arange(52), indexing="ij")
    places = torch.stack([rows, columns], dim=-1)
    squares = (places[:, :, None] - places[mask]).square().sum(-1).amin(-1)
    assert 0 < mask.sum() < 20
    assert torch.equal(dilate(mask.to(device), radius).cpu(), squares <= radius**2)


@pytest.mark.parametrize("size", [(0, 5), (5, 0), (4, 4)])
def test_nothing_grows_from_nothing(device, size):
    mask = torch.zeros(size, dtype=torch.bool, device=device)
    assert not dilate(mask, 3).any()
    assert torch.equal(dilate(~mask, 0).cpu(), ~mask.cpu())
