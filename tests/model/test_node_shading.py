"""Pictures whose points are shaded at nodes, against pictures in which every visible point is shaded by itself."""

import math

import pytest
import torch
from tiny_hair import tiny_hair_model
from torch.nn.functional import normalize

from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands, directions
from neural_strands.model.hair_model import HairModel
from neural_strands.model.hair_volume import hair_volume
from neural_strands.model.light import LightChange
from neural_strands.model.surround.body import SkinChange
from neural_strands.raster.splat import splat_pyramid
from neural_strands.raster.texture import sample_texture


def along(values, visible, vertex):
    """Rows of values at evenly spaced knots, at places given in vertices from 0 to 1."""
    place = vertex * (values.shape[1] - 1)
    before = place.floor().long().clamp(max=values.shape[1] - 2)
    return torch.lerp(
        values[visible.strand, before], values[visible.strand, before + 1], (place - before)[:, None].float()
    )


def each_by_itself(self, strands, visible, camera, viewpoint, blur=0.0, volume=None, light=None):
    """`HairModel.splat_descriptors` as it is defined."""
    ahead = directions(strands.points)
    ends = ahead[visible.strand, visible.vertex], ahead[visible.strand, visible.vertex + 1]
    direction = torch.lerp(*ends, visible.position[:, None])
    view = normalize(visible.world - camera.position, dim=1)
    around = hair_volume(strands.points).at(visible.world)
    turn = viewpoint.turn
    if turn is not None:
        direction, view = direction @ turn.T, view @ turn.T
        around = torch.cat([around[:, :3] @ turn.T, around[:, 3:]], dim=1)
    knots = self.textures.sample_appearance(strands.root_uv)
    elsewhere = sample_texture(self.textures.elsewhere, strands.root_uv).unflatten(1, knots.shape[1:])
    appearance = along(knots + viewpoint.elsewhere * elsewhere, visible, visible.t)
    change = torch.zeros(len(strands), knots.shape[1], 3)
    for texture, value in zip(self.textures.view, viewpoint.functions, strict=True):
        change += value * sample_texture(texture, strands.root_uv).unflatten(1, (-1, 3))
    fibre = torch.cat([direction, visible.t[:, None]], dim=1)
    linear = to_linear(self.shading(appearance, fibre, view, around) + along(change, visible, visible.t))
    if light is not None:
        share = (visible.vertex + visible.position) / (strands.points.shape[1] - 1)
        linear = linear * along(light.strands, visible, share)
    pixels, _ = camera.project(visible.world)
    descriptor = torch.cat([appearance, fibre, linear], dim=1)
    size = (camera.height, camera.width)
    return splat_pyramid(pixels, descriptor, size, self.config.unet.levels, amounts=visible.weight)


@pytest.mark.parametrize("turned", [False, True])
@torch.no_grad()
def test_pictures_are_those_in_which_every_point_is_shaded(generator, monkeypatch, turned):
    hair = tiny_hair_model(points=100)
    for texture in (hair.textures.appearance, hair.textures.elsewhere):
        texture.normal_(generator=generator)
    hair.textures.change_with_view()
    hair.textures.view.normal_(generator=generator).mul_(0.05)
    for weights in hair.shading.parameters():
        weights += 0.1 * torch.randn(weights.shape, generator=generator)
    directions_to_photographs = [[0.0, 0.0, 1.0], [0.1, 0.0, 1.0]] if turned else [[0.5, 0.2, -0.4], [0.2, 0.4, -0.5]]
    hair.photographed_from(normalize(torch.tensor(directions_to_photographs), dim=1))
    strands = hair.decode()
    # As after a cut: the points that are left reach only a part of t.
    t = torch.linspace(0, 0.8, 100).expand(len(strands), 100).clone()
    strands = Strands(strands.points, strands.root_uv, t=t)
    one = torch.ones(len(hair.body.vertices))
    skin = SkinChange(one, one[:, None].repeat(1, 3), 0 * one)
    light = LightChange(0.5 + torch.rand(len(strands), 5, 1, generator=generator), skin)
    camera = Camera.look_at(torch.tensor([0.5, 0.2, -0.4]), torch.zeros(3), 240.0, (96, 80))
    viewpoint = hair.viewpoint(camera)
    assert (viewpoint.turn is not None) == turned
    assert viewpoint.functions.any()
    if not turned:
        assert viewpoint.elsewhere == 0
        torch.testing.assert_close(hair.viewpoint(camera, photographed=True).functions, viewpoint.functions)
    found = hair.render(strands, camera, light=light)
    monkeypatch.setattr(HairModel, "splat_descriptors", each_by_itself)
    expected = hair.render(strands, camera, light=light)
    unlit = hair.render(strands, camera).rgb
    assert torch.equal(found.alpha > 0, expected.alpha > 0)
    difference = float((found.rgb - expected.rgb).square().mean())
    assert -10 * math.log10(difference) > 55
    # A picture without the change of light is not the same.
    assert float((unlit - expected.rgb).square().mean()) > 100 * difference
