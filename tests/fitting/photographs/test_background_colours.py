"""Colours of the background: means of pixels, and what lies around where there are none."""

import pytest
import torch

from neural_strands.fitting.photographs.background_colours import AROUND, background_colours, continued
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View
from neural_strands.model.surround.background import Background
from neural_strands.model.surround.body import SurroundConfig

RED, BLUE = torch.tensor([0.8, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.9])


@pytest.mark.parametrize("rows", [4, 96, 150])
def test_where_pixels_are_their_mean_is_kept_and_constants_are_everywhere(rows: int, generator):
    weight = 100.0 * (torch.rand(rows, 2 * rows, generator=generator) > 0.7)
    colour = torch.rand(3, rows, 2 * rows, generator=generator)
    found = continued(colour * weight, weight)
    assert (found - colour)[:, weight > 0].abs().max() < AROUND / 100
    same = RED[:, None, None].expand_as(colour)
    torch.testing.assert_close(continued(same * weight, weight), same.contiguous(), atol=1e-4, rtol=0)


def test_between_two_patches_colours_blend_across_the_seam_as_well():
    weight, total = torch.zeros(96, 192), torch.zeros(3, 96, 192)
    for colour, columns in ((RED, slice(40, 60)), (BLUE, slice(130, 150))):
        weight[30:60, columns] = 50.0
        total[:, 30:60, columns] = 50.0 * colour[:, None, None]
    found = continued(total, weight)
    steps = torch.cat([(found.roll(1, 2) - found).abs().flatten(), (found[:, 1:] - found[:, :-1]).abs().flatten()])
    assert steps.max() < 0.08
    assert (found >= torch.minimum(RED, BLUE)[:, None, None] - 1e-4).all()
    assert (found <= torch.maximum(RED, BLUE)[:, None, None] + 1e-4).all()
    assert found[0, 45, 70] > found[0, 45, 120], "redder beside the red patch"


def test_a_texel_that_hardly_any_pixel_shows_makes_no_seam():
    weight, total = torch.full((96, 192), 20.0), torch.zeros(3, 96, 192)
    total[:] = 20.0 * RED[:, None, None]
    weight[50, 100], total[:, 50, 100] = 0.01, 0.01 * BLUE
    assert (continued(total, weight)[:, 50, 100] - RED).abs().max() < 0.05


def test_means_are_those_of_the_pixels_with_weight(generator):
    background = Background(torch.zeros(3), SurroundConfig(background_texture=24, background_directions=12))
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 0.5]), torch.tensor([0.0, 0.0, -1.0]), 40.0, (64, 64))
    share = torch.ones(64, 64)
    share[:, 32:] = 0.0
    image = torch.full((64, 64, 3), 0.5)
    image[:, 32:] = torch.rand(64, 32, 3, generator=generator)
    colours = background_colours(background, [(View(camera, image), share)])
    assert colours is not None
    assert colours.shape == (3, 24, 48)
    torch.testing.assert_close(colours, torch.full_like(colours, ((0.5 + 0.055) / 1.055) ** 2.4), atol=1e-4, rtol=0)
    assert background_colours(background, [(View(camera, image), torch.zeros(64, 64))]) is None
