"""Drawn strands against streaks of known direction."""

import math

import pytest
import torch

from neural_strands.evaluation.strands_in_view import (
    HEADS,
    StrandsInView,
    drawn_orientation,
    mean_strands_in_view,
    strands_in_view,
)
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View
from neural_strands.raster.lines import rasterise_lines

SIZE = 96
CAMERA = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 480.0, (SIZE, SIZE))


def combed(degrees: float, upside_down: bool = False) -> torch.Tensor:
    """Parallel strands over the whole picture that run this many degrees from x towards down."""
    angle = math.radians(degrees)
    along = torch.tensor([math.cos(angle), -math.sin(angle), 0.0])
    across = torch.tensor([math.sin(angle), math.cos(angle), 0.0])
    steps = torch.linspace(-0.15, 0.15, 9)
    strands = torch.linspace(-0.15, 0.15, 300)[:, None, None] * across + steps[:, None] * along
    return strands.flip(1) if upside_down else strands


def streaks(degrees: float, generator: torch.Generator) -> torch.Tensor:
    """A photograph whose brightness varies only across this direction."""
    angle = math.radians(degrees)
    row, column = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    across = row * math.cos(angle) - column * math.sin(angle)
    waves = torch.rand(12, 2, generator=generator) * torch.tensor([0.8, 6.0]) + torch.tensor([1.0, 0.0])
    brightness = sum((across * wave + phase).sin() for wave, phase in waves.tolist())
    return (0.5 + 0.08 * torch.as_tensor(brightness))[..., None].expand(-1, -1, 3).clamp(0, 1)


def drawn(points: torch.Tensor, factor: int = 2):
    return rasterise_lines(points, CAMERA.resized(factor * SIZE, factor * SIZE), None)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 90.0, 155.0])
def test_orientations_of_drawn_strands_are_theirs_whatever_way_they_grow(degrees):
    for upside_down in (False, True):
        points = combed(degrees, upside_down)
        angle, share = drawn_orientation(drawn(points), points, CAMERA)
        shown = angle[share > 0.5]
        assert len(shown) > 0.5 * SIZE**2
        difference = (torch.rad2deg(shown) - degrees + 90).remainder(180) - 90
        assert difference.abs().max() < 1


def test_strands_along_the_streaks_are_right_and_those_across_are_not(generator):
    full = torch.ones(SIZE, SIZE)
    points = combed(30.0)
    for turned, low, high in ((30.0, 95.0, 100.0), (40.0, 80.0, 100.0), (60.0, 0.0, 15.0), (120.0, 0.0, 5.0)):
        view = View(CAMERA, streaks(turned, generator), full)
        found = strands_in_view(drawn(points), points, full, view).direction
        assert found is not None
        assert low <= found <= high


def test_hair_drawn_on_the_background_is_that_outside_the_person(generator):
    points, half = combed(30.0), torch.ones(SIZE, SIZE)
    half[:, SIZE // 2 :] = 0
    quarter = half.clone()
    quarter[SIZE // 2 :] = 0
    image, opaque = streaks(30.0, generator), torch.full((SIZE, SIZE), 0.8)
    lines = drawn(points)
    with_person = strands_in_view(lines, points, opaque, View(CAMERA, image, quarter, half))
    assert with_person.on_background == pytest.approx(50)
    assert strands_in_view(lines, points, opaque, View(CAMERA, image, quarter)).on_background == pytest.approx(75)
    assert strands_in_view(lines, points, opaque, View(CAMERA, image)).on_background is None
    nothing = strands_in_view(drawn(points[:0]), points, 0 * opaque, View(CAMERA, image, half))
    assert nothing == StrandsInView(None, None, 0.0)


def test_what_the_mask_itself_has_on_the_background(generator):
    # A hair mask that fades over four columns, of which the last two lie outside: 0.45 and 0.15 of 46 + 0.9 + 0.6.
    soft = torch.zeros(SIZE, SIZE)
    soft[:, :46] = 1
    soft[:, 46:50] = torch.tensor([0.9, 0.6, 0.45, 0.15])
    image, opaque, lines = streaks(30.0, generator), torch.ones(SIZE, SIZE), drawn(combed(30.0))
    expected = 100 * 0.6 / (46 + 0.9 + 0.6 + 0.6)
    alone = strands_in_view(lines, combed(30.0), opaque, View(CAMERA, image, soft))
    assert alone.mask_on_background == pytest.approx(expected, rel=1e-5)
    # Hair that is drawn exactly as the mask has that share, and no less.
    exact = strands_in_view(lines, combed(30.0), soft, View(CAMERA, image, soft))
    assert exact.on_background == exact.mask_on_background
    # A person that ends one column earlier, pixel by pixel.
    person = torch.zeros(SIZE, SIZE)
    person[:, :47] = 1
    inside = outside = 0.0
    for value, covered in zip(soft.flatten().tolist(), person.flatten().tolist(), strict=True):
        inside, outside = inside + value * (covered >= 0.5), outside + value * (covered < 0.5)
    with_person = strands_in_view(lines, combed(30.0), opaque, View(CAMERA, image, soft, person))
    assert with_person.mask_on_background == pytest.approx(100 * outside / (inside + outside), rel=1e-5)
    without_hair = strands_in_view(lines, combed(30.0), opaque, View(CAMERA, image, None, person))
    assert without_hair.mask_on_background is None
    assert without_hair.on_background is not None


def test_means_are_over_the_views_that_have_a_figure():
    found = [StrandsInView(80.0, None, 3.0), StrandsInView(60.0, 4.0, 1.0), StrandsInView(None, None, None)]
    assert mean_strands_in_view(found) == StrandsInView(70.0, 4.0, 2.0)
    assert mean_strands_in_view([]) == StrandsInView(None, None, None)
    assert len(found[0].cells()) == len(HEADS)
    assert found[0].cells() == ("80.0", "-", "3.0")
