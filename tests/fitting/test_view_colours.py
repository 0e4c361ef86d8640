"""Colours that change with the view, in closed form, against planted ones."""

from dataclasses import replace

import pytest
import torch
from tiny_hair import tiny_hair_model

from neural_strands.fitting import view_colours
from neural_strands.fitting.first_colours import initialise_colours
from neural_strands.fitting.view_colours import improve_colours, initialise_view_colours
from neural_strands.foundation.srgb import to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.geometry.views import View
from neural_strands.model.seen_directions import seen_from

VIEWS = 24


@torch.no_grad()
def hair_colours(model, strands, camera):
    """Encoded colour of the hair, and where strands cover a pixel well."""
    image = model.render_hair(strands, camera, photographed=True)
    return to_srgb(image.rgb), (image.coverage > view_colours.LEAST_COVERAGE).float()


@pytest.fixture
def planted(generator):
    """A model whose image generator corrects nothing, with colours that change with the view, and photographs of it."""
    model = tiny_hair_model(strands=500)
    model.strand_width = 2e-3
    model.config = replace(model.config, unet=replace(model.config.unet, corrects=False))
    with torch.no_grad():
        strands = model.decode()
    cameras = [c for height in (0.2, 0.8) for c in turntable_cameras(strands.points, VIEWS // 2, (96, 96), height)]
    model.photographed_from(seen_from(torch.stack([camera.position for camera in cameras]), model.background.centre))
    model.textures.change_with_view()
    with torch.no_grad():
        model.shading.decode[:, :3] = torch.eye(3)
        model.shading.mean.fill_(0.5)
        model.textures.appearance[..., :3] = 0.1 * torch.randn(8, 8, 3, generator=generator)
        model.textures.view.copy_(0.03 * torch.randn(model.textures.view.shape, generator=generator))
    views = []
    for camera in cameras:
        image, hair = hair_colours(model, strands, camera)
        views.append(View(camera, image, hair))
    with torch.no_grad():
        model.textures.appearance.zero_()
        model.textures.view.zero_()
    return model, strands, views


def error(model, strands, view):
    """Root mean square of the error of the hair."""
    image, hair = hair_colours(model, strands, view.camera)
    return float((image - view.image)[hair > 0].square().mean().sqrt())


def test_planted_changes_are_found_also_for_views_that_were_held_out(planted, monkeypatch):
    monkeypatch.setattr(view_colours, "RIDGE_COLOUR", 0.01)
    monkeypatch.setattr(view_colours, "RIDGE_VIEW", 0.01)
    model, strands, views = planted
    held, shown = views[5], [view for view in views if view is not views[5]]
    initialise_colours(model, strands, shown)
    before = error(model, strands, held), error(model, strands, shown[0])
    initialise_view_colours(model, strands, shown)
    after = error(model, strands, held), error(model, strands, shown[0])
    assert after[0] < 0.35 * before[0]
    assert after[1] < 0.2 * before[1]


def test_what_renderings_lack_is_found_whatever_the_networks_make_of_colours(planted, monkeypatch, generator):
    monkeypatch.setattr(view_colours, "RIDGE_COLOUR", 0.01)
    monkeypatch.setattr(view_colours, "RIDGE_VIEW", 0.01)
    model, strands, views = planted

    def rendered(view):
        with torch.no_grad():
            return model.render(strands, view.camera, photographed=True)

    outputs = [rendered(view) for view in views]
    views = [View(view.camera, out.rgb, out.alpha) for view, out in zip(views, outputs, strict=True)]
    with torch.no_grad():
        model.shading.mean += 0.05
        model.textures.view += 0.03 * torch.randn(model.textures.view.shape, generator=generator)

    def errors():
        sure = [view.hair_mask > view_colours.LEAST_HAIR for view in views]
        assert min(int(part.sum()) for part in sure) > 50
        return [float((rendered(v).rgb - v.image)[part].square().mean()) for v, part in zip(views, sure, strict=True)]

    before = errors()
    improve_colours(model, strands, views)
    assert all(now < 0.03 * then for now, then in zip(errors(), before, strict=True))


def test_without_hair_masks_and_without_visible_hair_nothing_breaks(planted):
    model, strands, views = planted
    initialise_view_colours(model, strands, [replace(view, hair_mask=None) for view in views[:2]])
    assert model.textures.view.isfinite().all()
    assert model.textures.view.any()
    behind = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, 0.0, 2.0]), 100.0, (8, 8))
    with torch.no_grad():
        model.textures.view.zero_()
    initialise_view_colours(model, strands, [View(behind, torch.zeros(8, 8, 3), torch.zeros(8, 8))])
    assert not model.textures.view.any()
