"""Trimaps of discs: their borders are where the radii say."""

import pytest
import torch

from neural_strands.fitting.photographs.trimap import TrimapConfig, reference_alpha, trimap_of_part
from neural_strands.geometry.rectangle import Rectangle


def make_trimap(lines, config):
    return trimap_of_part(lines, Rectangle(0, 0, *reversed(lines.shape)), config)


def disc(radius, side=101):
    offset = torch.arange(side) - side // 2
    return (offset[:, None].square() + offset.square()).sqrt() <= radius


def test_trimap_is_sure_inside_and_outside_and_silent_between():
    trimap = make_trimap(disc(30), TrimapConfig(dilation=0.03, erosion=0.05))
    grow, shrink = round(0.03 * 101 * 2**0.5), round(0.05 * 101 * 2**0.5)
    inside, outside = disc(30 - shrink - 2), ~disc(30 + grow + 1)
    assert trimap.supervised[inside].all()
    assert (trimap.alpha[inside] == 1).all()
    assert trimap.supervised[outside].all()
    assert (trimap.alpha[outside] == 0).all()
    border = disc(30) & ~disc(29)
    assert not trimap.supervised[border].any()


def test_holes_between_lines_close():
    lines = torch.zeros(101, 101, dtype=torch.bool)
    lines[20:80, 20:80:3] = True
    trimap = make_trimap(lines, TrimapConfig(dilation=0.03, erosion=0.03))
    assert (trimap.alpha[40:60, 40:60] == 1).all()


@pytest.mark.parametrize("place", [Rectangle(0, 0, 30, 40), Rectangle(33, 20, 48, 16), Rectangle(61, 70, 40, 31)])
def test_a_part_is_what_the_whole_says_there(generator, place):
    lines = (torch.rand(101, 101, generator=generator) > 0.97) & disc(40)
    config = TrimapConfig(dilation=0.02, erosion=0.01)
    whole, part = make_trimap(lines, config), trimap_of_part(lines, place, config)
    assert torch.equal(part.alpha, place.of(whole.alpha))
    assert torch.equal(part.supervised, place.of(whole.supervised))


def test_a_matte_is_taken_as_it_is_unless_told_otherwise(generator):
    matte = torch.rand(50, 60, generator=generator)
    place = Rectangle(7, 5, 20, 30)
    taken = reference_alpha(matte, place, TrimapConfig())
    assert torch.equal(taken.alpha, matte[5:35, 7:27])
    assert taken.supervised.all()
    doubted = reference_alpha(matte, place, TrimapConfig(mattes=False))
    assert torch.equal(doubted.supervised, trimap_of_part(matte > 0.5, place).supervised)
