"""Colours of strands from what a model renders."""

from dataclasses import replace

import torch
from tiny_hair import tiny_hair_model

from neural_strands.model.renderer import HairRenderer
from neural_strands.model.strand_colours import cameras_around, strand_colours


def test_hair_that_renders_in_one_colour_has_that_colour(monkeypatch):
    renderer = HairRenderer.of(tiny_hair_model(100))
    render = HairRenderer.render_hair

    def painted(self, camera):
        image = render(self, camera)
        return image._replace(rgb=torch.tensor([1.0, 0.5, 0.0]).expand_as(image.rgb))

    monkeypatch.setattr(HairRenderer, "render_hair", painted)
    colours = strand_colours(renderer, cameras_around(renderer)[:3])
    assert torch.allclose(colours, torch.tensor([1.0, 0.5, 0.0]).expand(100, 3), atol=1e-5)


def test_a_strand_that_no_view_sees_takes_its_neighbours_colour():
    renderer = HairRenderer.of(tiny_hair_model(100))
    points = renderer.strands.points.clone()
    # From below the skin to the centre of the ball.
    points[0, :, :] = 0.0
    points[0, 0] = 0.8 * points[7, 0]
    changed = renderer.showing(replace(renderer.strands, points=points))
    colours = strand_colours(changed, cameras_around(renderer))
    beside = int((points[1:, 0] - points[0, 0]).norm(dim=1).argmin()) + 1
    assert torch.equal(colours[0], colours[beside])
