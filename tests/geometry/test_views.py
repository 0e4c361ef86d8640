"""Views: what is read and when, and that parts, reductions and selections match their cameras."""

from dataclasses import replace

import pytest
import torch

from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.views import View, Views

PARTS = ("image", "hair_mask", "person_mask")


@pytest.fixture
def camera() -> Camera:
    return Camera.look_at(torch.tensor([0.1, 0.2, 1.0]), torch.zeros(3), 200.0, (100, 80), "front")


@pytest.fixture
def view(camera, generator) -> View:
    return View(camera, *(torch.rand(80, 100, *channels, generator=generator) for channels in ((3,), (), ())))


def test_a_part_of_a_view_sees_the_same_through_the_same_pixels(view, generator):
    part = view.cropped(Rectangle(30, 20, 40, 25))
    assert (part.camera.width, part.camera.height) == (40, 25)
    for name in PARTS:
        assert torch.equal(getattr(part, name), getattr(view, name)[20:45, 30:70])
    points = 0.1 * torch.randn(20, 3, generator=generator)
    offset = view.camera.project(points)[0] - part.camera.project(points)[0]
    torch.testing.assert_close(offset, torch.tensor([30.0, 20.0]).expand(20, 2), atol=1e-3, rtol=0)
    bare = View(view.camera, view.image).cropped(Rectangle(0, 0, 3, 4))
    assert bare.hair_mask is None
    assert bare.person_mask is None


def test_nothing_is_read_before_it_is_asked_for_and_nothing_twice_at_once(view):
    asked = []

    def read(index, part):
        asked.append((index, part))
        return None if part == "hair_mask" and index == 1 else getattr(view, part)

    views = Views((view.camera,) * 3, (True, False, True), read)
    assert len(views) == 3
    assert views.reduced(50).cameras[0].width == 50
    assert asked == []
    assert [mask is view.hair_mask for _, mask in views.hair_masks()] == [True, True]
    assert asked == [(0, "hair_mask"), (2, "hair_mask")]
    asked.clear()
    whole = views[1]
    assert whole.hair_mask is None
    assert whole.image is view.image
    assert sorted(asked) == [(1, part) for part in sorted(PARTS)]
    asked.clear()
    assert [one.camera is view.camera for one in views] == [True] * 3
    assert len(asked) == 9


def test_a_view_without_a_photograph_is_refused(camera):
    with pytest.raises(ValueError, match="front: expected a photograph"):
        Views((camera,), (False,), lambda index, part: None)[0]


def test_reduced_views_average_areas_and_keep_what_their_rays_meet(view, generator):
    small = Views.in_memory([view]).reduced(50)[0]
    assert (small.camera.width, small.camera.height) == (50, 40)
    light = to_linear(view.image).reshape(40, 2, 50, 2, 3).mean(dim=(1, 3))
    torch.testing.assert_close(to_linear(small.image), light, atol=1e-6, rtol=0)
    for name in PARTS[1:]:
        mean = getattr(view, name).reshape(40, 2, 50, 2).mean(dim=(1, 3))
        torch.testing.assert_close(getattr(small, name), mean, atol=1e-6, rtol=0)
    points = 0.1 * torch.randn(20, 3, generator=generator)
    torch.testing.assert_close(2 * small.camera.project(points)[0], view.camera.project(points)[0], atol=1e-3, rtol=0)
    assert Views.in_memory([view]).reduced(100)[0].image is view.image
    assert Views.in_memory([View(view.camera, view.image)]).reduced(10)[0].hair_mask is None


def test_selected_views_are_read_by_their_old_indices(view):
    bare = View(replace(view.camera, name="bare"), 1 - view.image)
    chosen = replace(Views.in_memory([view, bare, view]), witnesses=2).selected([1, 2])
    assert [camera.name for camera in chosen.cameras] == ["bare", view.camera.name]
    assert chosen.has_hair_mask == (False, view.hair_mask is not None)
    assert torch.equal(chosen.image(0), 1 - view.image)
    assert chosen[1].image is view.image
    assert chosen.witnesses == 2
