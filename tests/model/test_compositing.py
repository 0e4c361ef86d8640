"""What lies behind and around the hair."""

import math

import pytest
import torch

from neural_strands.model.compositing import (
    BESIDE,
    CONTEXT,
    COVERED,
    DENSEST,
    REACH,
    area_mean,
    between_lines,
    hair_rectangle,
    near_hair,
    surrounding_odds,
)
from neural_strands.raster.openings import openings

SKIN = (0.6, 0.4, 0.3)


def skin_between(is_body: torch.Tensor, is_hair: torch.Tensor, factor: int) -> tuple[torch.Tensor, torch.Tensor]:
    """What shows of skin of one colour between hair; both are given at the resolution of lines."""
    seen = openings(torch.where(is_body, 1.0, torch.inf), is_hair.long() - 1, factor)
    return between_lines((seen.surface > 0)[..., None] * torch.tensor(SKIN), seen)


def test_hair_is_near_its_strands_alone():
    coverage = torch.zeros(90, 70)
    coverage[40, 2:5] = 0.3
    coverage[89, 69] = 0.01
    near = near_hair(coverage)
    rows, columns = torch.meshgrid(torch.arange(90), torch.arange(70), indexing="ij")
    places = torch.stack([rows, columns], dim=-1)
    apart = (places[:, :, None] - torch.nonzero(coverage)).abs().amax(dim=-1).amin(dim=-1)
    assert (near[apart <= REACH] == 1).all()
    assert (near[apart > 3 * REACH] == 0).all()
    between = near[(apart > REACH + 1) & (apart < 3 * REACH)]
    assert ((between > 0) & (between < 1)).all()


def test_dense_hair_raises_the_odds_of_its_gaps():
    random = torch.Generator().manual_seed(0)
    coverage = torch.rand(11, 9, generator=random) * torch.linspace(0, 2, 9)
    coverage = coverage.clamp(max=1.0)
    odds = surrounding_odds(coverage)
    means = torch.tensor(
        [[float(coverage[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3].mean()) for x in range(9)] for y in range(11)]
    )
    assert (means < 0.4).any()
    assert (means > 0.8).any()
    expected = [[math.log(mean / (1 - mean)) if mean > 0.5 else 0.0 for mean in row] for row in means.tolist()]
    torch.testing.assert_close(odds, torch.tensor(expected))
    assert surrounding_odds(torch.ones(6, 7)).allclose(torch.tensor(math.log(DENSEST / (1 - DENSEST))))


def test_the_rectangle_of_hair_holds_all_that_hair_can_reach():
    random = torch.Generator().manual_seed(0)
    for size in ((90, 70), (300, 210), (5, 3), (1, 1)):
        for _ in range(5):
            coverage = torch.zeros(size)
            coverage[tuple(int(torch.randint(side, (1,), generator=random)) for side in size)] = 0.1
            part = hair_rectangle(coverage, 4)
            place = near_hair(coverage).nonzero()
            for axis, (begin, length) in enumerate(((part.top, part.height), (part.left, part.width))):
                first, last, side = int(place[:, axis].min()), int(place[:, axis].max()), size[axis]
                assert begin % 4 == 0
                assert begin + length == side or length % 4 == 0
                assert max(first - CONTEXT - 4, -1) < begin <= max(first - CONTEXT, 0)
                assert min(last + CONTEXT + 1, side) <= begin + length <= min(last + CONTEXT + 10, side)
    nothing = hair_rectangle(torch.zeros(30, 2), 4)
    assert (nothing.width, nothing.height) == (2, 4)


def test_nearness_is_the_mean_of_what_lies_within_reach():
    """Pixel by pixel, also at the borders and in pictures smaller than the window."""
    random = torch.Generator().manual_seed(0)
    for height, width in ((50, 37), (1, 1), (5, 40)):
        coverage = (torch.rand(height, width, generator=random) < 4 / (height * width)).float()

        def around(image, row, column, reach):
            return image[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]

        pixels = [(row, column) for row in range(height) for column in range(width)]
        within = torch.tensor([float(around(coverage, *pixel, 2 * REACH).any()) for pixel in pixels])
        within = within.view(height, width)
        expected = torch.tensor([float(around(within, *pixel, REACH).mean()) for pixel in pixels])
        torch.testing.assert_close(near_hair(coverage), expected.view(height, width), rtol=0, atol=1e-6)


@pytest.mark.parametrize("factor", [1, 2, 3])
@pytest.mark.parametrize("channels", [1, 3])
def test_area_means_are_those_of_every_square(generator, factor, channels):
    image = torch.rand(7, 10, channels, generator=generator, dtype=torch.float64).requires_grad_()
    mean = area_mean(image, factor)
    assert mean.shape == (7 // factor, 10 // factor, channels)
    for row in range(7 // factor):
        for column in range(10 // factor):
            square = image[row * factor : (row + 1) * factor, column * factor : (column + 1) * factor]
            torch.testing.assert_close(mean[row, column], square.flatten(0, 1).mean(dim=0))
    assert torch.autograd.gradcheck(lambda values: area_mean(values, factor), image)


@pytest.mark.parametrize("factor", [1, 3])
def test_what_lies_between_lines_is_the_mean_over_open_line_pixels(generator, factor):
    height, width = 4, 5
    is_body, is_hair = torch.rand(2, factor * height, factor * width, generator=generator) > 0.5
    share, colour = skin_between(is_body, is_hair, factor)

    def square(row, column):
        """Line pixels of one pixel: whether each is open, and whether it is body."""
        part = (slice(row * factor, (row + 1) * factor), slice(column * factor, (column + 1) * factor))
        both = zip(is_hair[part].flatten(), is_body[part].flatten(), strict=True)
        return [(not hair, bool(body)) for hair, body in both]

    for row in range(height):
        for column in range(width):
            body = total = 0.0
            for covered_too, weight, pixels in (
                (COVERED, 1.0, [(row, column)]),
                (0.0, BESIDE / 9, [(row + y, column + x) for y in (-1, 0, 1) for x in (-1, 0, 1)]),
            ):
                for pixel in pixels:
                    if 0 <= pixel[0] < height and 0 <= pixel[1] < width:
                        for is_open, is_skin in square(*pixel):
                            body += weight * (is_open + covered_too) * is_skin
                            total += weight * (is_open + covered_too)
            assert float(share[row, column]) == pytest.approx(body / total, abs=1e-5)
            assert colour[row, column].tolist() == pytest.approx([body / total * each for each in SKIN], abs=1e-5)


def test_no_rim_of_background_runs_along_a_face_in_front_of_hair():
    """A face ends in the middle of a pixel, and hair fills all that it leaves."""
    is_body = torch.zeros(9, 24, dtype=torch.bool)
    is_body[:, :14] = True
    share, _ = skin_between(is_body, ~is_body, 3)
    # The pixel that the outline crosses, and the one beside it, let face shine through; those farther off, background.
    assert share[1, :6, 0].min() > 0.7
    assert share[1, 6:, 0].max() == 0
    assert share[1, 4, 0] > 0.99


def test_without_hair_the_body_is_as_it_was_drawn():
    is_body = torch.zeros(9, 24, dtype=torch.bool)
    is_body[:, :14] = True
    share, colour = skin_between(is_body, torch.zeros_like(is_body), 3)
    plain = area_mean(is_body[..., None].float(), 3)
    assert (share - plain).abs().max() < BESIDE
    torch.testing.assert_close(colour, share * torch.tensor(SKIN))
