"""Regions of a photograph."""

import pytest
import torch

from neural_strands.fitting.photographs.regions import MarkedPixels, inner_part, random_square
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.views import View


def test_crops_are_aligned_and_about_the_hair(generator):
    mask = torch.zeros(100, 120)
    mask[60:64, 90:95] = 1
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 100.0, (120, 100))
    whole = View(camera, torch.rand(100, 120, 3, generator=generator), mask)
    for _ in range(5):
        part = whole.cropped(random_square(MarkedPixels.of(mask > 0.5), (100, 120), 48, 8, generator))
        assert part.image.shape == (48, 48, 3)
        assert part.hair_mask.sum() == 20
        left, top = (whole.camera.intrinsics - part.camera.intrinsics)[:2, 2].tolist()
        assert (left % 8, top % 8) == (0, 0)
        torch.testing.assert_close(part.image, whole.image[int(top) : int(top) + 48, int(left) : int(left) + 48])


def test_a_small_image_is_taken_whole_and_an_empty_one_from_its_middle(generator):
    assert random_square(None, (30, 40), 48, 8, generator) == Rectangle(0, 0, 40, 30)
    unmarked = MarkedPixels.of(torch.zeros(100, 100, dtype=torch.bool))
    assert random_square(unmarked, (100, 100), 20, 4, generator) == Rectangle(40, 40, 20, 20)


@pytest.mark.parametrize("share", [0.02, 0.5, 1.0])
def test_marked_pixels_are_numbered_row_after_row(device, share):
    marked = torch.rand(13, 17, generator=torch.Generator().manual_seed(1)) < share
    found, expected = MarkedPixels.of(marked.to(device)), marked.flatten().nonzero().squeeze(1).tolist()
    assert len(found) == len(expected) > 0
    assert [found[number] for number in range(len(found))] == expected


def test_margins_are_left_of_regions_that_can_spare_them():
    assert inner_part((50, 60), 8) == Rectangle(8, 8, 44, 34)
    assert inner_part((30, 60), 8) == Rectangle(0, 0, 60, 30)
