"""Orientation, depth and differences in colours, at places where the colour is known."""

import torch

from neural_strands.pictures.fields import depth_picture, difference_picture, orientation_picture


def test_difference_is_dark_where_images_agree_and_saturates():
    image = torch.zeros(2, 2, 3)
    other = image.clone()
    other[0, 0] = 0.25
    heat = difference_picture(image, other, gain=4.0)
    assert heat[1, 1].max() < 0.02
    torch.testing.assert_close(heat[0, 0], torch.tensor([0.988, 0.998, 0.645]), atol=2e-3, rtol=0)


def test_orientation_turns_once_round_the_hues_over_half_a_turn():
    angle = torch.linspace(0, torch.pi, 65)[:-1].expand(64, -1)
    texture = torch.stack([(2 * angle).cos(), (2 * angle).sin(), *2 * [torch.ones_like(angle)]], dim=-1)
    picture = orientation_picture(texture)
    # Red, green and blue at 0, 60 and 120 degrees, below the wheel.
    for degrees, channel in ((0, 0), (60, 1), (120, 2)):
        colour = picture[40, round(64 * degrees / 180)]
        assert colour[channel] > 0.95
        assert colour.sum() < 1.2
    dark = texture.clone()
    dark[32:, :, 2] = 0
    assert orientation_picture(dark)[40:].max() == 0


def test_depth_runs_from_blue_to_red_and_fills_blocks_of_a_coarse_grid():
    pixel = torch.cartesian_prod(torch.arange(0, 8, 2), torch.arange(0, 6, 2))
    picture = depth_picture(pixel, pixel[:, 0] / 6, (6, 8))
    assert (picture.sum(dim=-1) > 0).all()
    assert picture[0, 0].argmax() == 2
    assert picture[5, 7].argmax() == 0
    torch.testing.assert_close(picture[:, 0], picture[:, 1])
    assert depth_picture(pixel[:0], torch.zeros(0), (6, 8)).max() == 0
