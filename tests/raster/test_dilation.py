"""Dilation by a disc agrees with the distance to the mask, widening with the maximum of every square."""

import pytest
import torch

from neural_strands.raster.dilation import dilate, widen


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


@pytest.mark.parametrize("radius", [1, 2, 6])
def test_widen_takes_the_maximum_of_a_square(generator, radius):
    image = torch.randn(17, 23, generator=generator) - 5
    assert widen(image, 0) is image
    squares = [
        image[max(y - radius, 0) : y + radius + 1, max(x - radius, 0) : x + radius + 1].max()
        for y in range(17)
        for x in range(23)
    ]
    assert torch.equal(widen(image, radius), torch.stack(squares).view(17, 23))
