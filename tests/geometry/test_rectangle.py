"""Parts of images."""

import pytest
import torch

from neural_strands.geometry.rectangle import Rectangle


def test_a_part_goes_back_to_its_place():
    image = torch.rand(11, 13, 2)
    part = Rectangle(4, 2, 6, 9)
    back = part.padded(part.of(image), 11, 13)
    rows, columns = torch.meshgrid(torch.arange(11), torch.arange(13), indexing="ij")
    inside = (columns >= 4) & (columns < 10) & (rows >= 2)
    assert torch.equal(back[inside], image[inside])
    assert (back[~inside] == 0).all()


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_the_same_part_of_a_reduced_image(factor):
    # A reduced pixel belongs to the part if any of its pixels does.
    part, image = Rectangle(4, 8, 9, 6), torch.zeros(14, 13)
    part.of(image).fill_(1)
    small = torch.nn.functional.max_pool2d(image[None, None], factor, ceil_mode=True)[0, 0]
    expected = torch.zeros_like(small)
    part.reduced(factor).of(expected).fill_(1)
    assert torch.equal(small, expected)
