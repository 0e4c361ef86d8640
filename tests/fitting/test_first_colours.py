"""First colours in closed form: those of the pixels that show them."""

from dataclasses import replace

import pytest
import torch

from neural_strands.fitting.first_colours import (
    AS_SEEN,
    UNDER_HAIR,
    body_texture,
    colours_under_hair,
    fill_texture,
    initialise_colours,
    photographed_colours,
    scatter_to_texture,
)
from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.surround.body import SurroundConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.face_atlas import FaceAtlas
from neural_strands.raster.texture import sample_texture
from neural_strands.scalp.roots import Roots

STRANDS = 80
BLUE = torch.tensor([0.0, 0.0, 1.0])[:, None, None]


@pytest.fixture
def scene(generator):
    """A model, upright strands on a square, and two cameras above them."""
    position = torch.rand(STRANDS, 3, generator=generator) * torch.tensor([0.1, 0.0, 0.1])
    frame = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]).T.expand(STRANDS, 3, 3).contiguous()
    uv = 10 * position[:, [0, 2]]
    corners = torch.tensor([[-0.05, -1e-3, -0.05], [0.15, -1e-3, -0.05], [0.15, -1e-3, 0.15], [-0.05, -1e-3, 0.15]])
    body = Mesh(corners, torch.tensor([[0, 2, 1], [0, 3, 2]]))
    config = HairModelConfig(
        ScalpTextureConfig(shape_size=4, appearance_size=128, appearance_channels=4),
        UNetConfig(widths=(8, 8)),
        SurroundConfig(background_texture=4, background_directions=6),
        supersample=1,
    )
    model = HairModel(config, Roots(position, uv, frame, torch.zeros(STRANDS)), StrandGenerator(), body, generator)
    along = torch.linspace(0, 0.02, 6)[:, None] * torch.tensor([0.5, 1.0, 0.0])
    strands = Strands(position[:, None] + along, root_uv=uv)
    middle = torch.tensor([0.05, 0.0, 0.05])
    eyes = ([0.05, 0.4, 0.3], [0.2, 0.5, 0.05])
    cameras = [Camera.look_at(torch.tensor(eye), middle, 120.0, (64, 48)) for eye in eyes]
    return model, strands, cameras


def painted(model: HairModel, strands: Strands, camera: Camera, colour: torch.Tensor) -> View:
    """Strands of given colours wherever one is drawn, white body, blue background."""
    drawing = model.draw(strands, camera)
    hair = drawing.lines.segment >= 0
    strand = drawing.lines.segment.clamp(min=0) // (strands.points_per_strand - 1)
    image = torch.where((drawing.body.face >= 0)[..., None], torch.ones(3), torch.tensor([0.0, 0.0, 1.0]))
    return View(camera, torch.where(hair[..., None], colour[strand], image), hair.float())


def test_spreading_is_the_transpose_of_sampling(generator):
    uv, values = torch.rand(20, 2, generator=generator), torch.randn(20, 3, generator=generator)
    texture = torch.randn(6, 7, 3, generator=generator)
    total, weight = scatter_to_texture(values, uv, 6, 7)
    torch.testing.assert_close((total * texture).sum(), (values * sample_texture(texture, uv)).sum())
    torch.testing.assert_close(weight.sum(), torch.tensor(20.0))


def test_filling_keeps_what_is_known_and_constants_everywhere(generator):
    weight = (torch.rand(9, 13, 1, generator=generator) > 0.8).float()
    values = torch.randn(9, 13, 2, generator=generator)
    result = fill_texture(values * weight, weight)
    torch.testing.assert_close(result[weight[..., 0] > 0], values[weight[..., 0] > 0])
    assert result.isfinite().all()
    torch.testing.assert_close(fill_texture(3 * weight.expand(-1, -1, 2), weight), torch.full((9, 13, 2), 3.0))


def test_texels_that_no_pixel_shows_take_the_colour_at_the_corners_of_their_face():
    square = torch.tensor([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    atlas, body = FaceAtlas(2, 9), Mesh(square, torch.tensor([[0, 1, 2], [2, 1, 3]]))
    texels = atlas.texels()
    weight = torch.zeros(atlas.size**2, 1)
    weight[texels.texel[texels.face == 0]] = 50.0
    colour = torch.tensor([0.2, 0.4, 0.6])
    shape = (atlas.size, atlas.size, -1)
    found = body_texture(
        (weight * colour).view(shape), weight.view(shape), atlas, body, torch.zeros(len(body.vertices), 4)
    ).view(-1, 3)[texels.texel]
    torch.testing.assert_close(found, colour.expand_as(found))
    # One red texel among many does not colour its face.
    total = weight * colour
    speck = texels.texel[texels.face == 1][5]
    weight[speck], total[speck] = 0.05, torch.tensor([0.05, 0.0, 0.0])
    found = body_texture(total.view(shape), weight.view(shape), atlas, body, bare(body)).view(-1, 3)
    others = texels.texel[texels.texel != speck]
    assert (found[others] - colour).abs().max() < 0.01
    assert (found[speck] - colour).abs().max() < 0.2


def test_where_nothing_is_seen_the_body_continues_what_lies_around():
    """Not the mean of the whole body: a strip that begins red stays red beside a large blue patch."""
    strip = torch.tensor([[float(k // 2), float(k % 2), 0.0] for k in range(8)])
    faces = torch.tensor([[k, k + 1, k + 2] for k in range(6)])
    patch = torch.tensor([[20.0, 0.0, 0.0], [30.0, 0.0, 0.0], [20.0, 9.0, 0.0]])
    body = Mesh(torch.cat([strip, patch]), torch.cat([faces, torch.tensor([[8, 9, 10]])]))
    atlas = FaceAtlas(7, 9)
    texels = atlas.texels()
    red, blue = torch.tensor([0.5, 0.1, 0.1]), torch.tensor([0.0, 0.0, 0.9])
    weight, total = torch.zeros(atlas.size**2, 1), torch.zeros(atlas.size**2, 3)
    for face, colour in ((0, red), (6, blue)):
        there = texels.texel[texels.face == face]
        weight[there], total[there] = 50.0, 50.0 * colour
    shape = (atlas.size, atlas.size, -1)
    found = body_texture(total.view(shape), weight.view(shape), atlas, body, bare(body)).view(-1, 3)
    unseen = found[texels.texel[(texels.face > 0) & (texels.face < 6)]]
    torch.testing.assert_close(unseen, red.expand_as(unseen), atol=1e-3, rtol=0)


def test_scalp_that_no_photograph_shows_has_a_darker_shade_of_the_hair_that_grows_there(generator):
    """Along a strip: skin that is seen, skin that is not, red hair, hair that no photograph shows, and skin again."""
    corners = torch.tensor([[float(k // 2), float(k % 2), 0.0] for k in range(42)])
    quads = [[2 * k, 2 * k + 1, 2 * k + 2] for k in range(20)] + [[2 * k + 2, 2 * k + 1, 2 * k + 3] for k in range(20)]
    body, atlas = Mesh(corners, torch.tensor(quads)), FaceAtlas(40, 20)
    red, skin = torch.tensor([0.5, 0.1, 0.1]), torch.tensor([0.8, 0.6, 0.5])
    roots = torch.rand(200, 3, generator=generator) * torch.tensor([8.0, 1.0, 0.01]) + torch.tensor([8.0, 0.0, 0.0])
    photographed = (roots[:, 0] < 14).float()
    strands = Strands(roots[:, None].repeat(1, 3, 1))
    scalp = colours_under_hair(strands, photographed[:, None] * red, photographed, body)
    assert (scalp[:, 3] > 0).tolist() == [8 <= k // 2 <= 16 for k in range(42)]
    inner, shade = scalp[18:32], UNDER_HAIR * red
    torch.testing.assert_close(inner, torch.cat([shade, torch.ones(1)]).expand_as(inner), atol=1e-4, rtol=0)
    texels, column = atlas.texels(), atlas.texels().face % 20
    weight, total = torch.zeros(atlas.size**2, 1), torch.zeros(atlas.size**2, 3)
    seen = texels.texel[column < 4]
    weight[seen], total[seen] = 50.0, 50.0 * skin
    shape = (atlas.size, atlas.size, -1)
    found = body_texture(total.view(shape), weight.view(shape), atlas, body, scalp).view(-1, 3)[texels.texel]
    for there, expected in ((column < 7, skin), ((column > 8) & (column < 15), shade), (column > 16, skin)):
        torch.testing.assert_close(found[there], expected.expand(int(there.sum()), 3), atol=0.02, rtol=0)
    nowhere = colours_under_hair(strands, red.expand(len(roots), 3), torch.zeros(len(roots)), body)
    assert not nowhere[:, 3].any()


def test_first_colours_are_those_of_the_pixels(scene, generator):
    model, strands, cameras = scene
    colour = torch.rand(STRANDS, 3, generator=generator)
    targets = [painted(model, strands, camera, colour) for camera in cameras]
    found, weight = photographed_colours(model, strands, targets)
    seen = weight > 0
    assert seen.sum() > STRANDS // 2
    torch.testing.assert_close(found[seen], to_linear(colour[seen]))
    initialise_colours(model, strands, targets)
    own = model.body.colour.detach().flatten(0, 1)[model.body.atlas.texels().texel]
    torch.testing.assert_close(own, torch.ones_like(own))
    torch.testing.assert_close(model.background.colour, BLUE.expand_as(model.background.colour))
    stored = model.textures.sample_appearance(strands.root_uv)[:, 0, :3].detach() + model.shading.mean.detach()
    assert (stored - to_srgb(found))[seen].abs().mean() < 0.05


@pytest.mark.parametrize("cover", [0.3, 0.5, 0.8])
def test_thin_hair_before_the_body_hardly_colours_it(scene, cover):
    """Between dense, dark locks, hair lets a part of the white body through."""
    model, _, cameras = scene
    dark, targets = torch.tensor([0.1, 0.06, 0.03]), []
    for camera in cameras:
        dense = torch.arange(camera.width) % 8 < 2
        hair = torch.where(dense, 1.0, cover).expand(camera.height, -1)
        light = hair[..., None] * dark + (1 - hair[..., None])
        targets.append(View(camera, to_srgb(light), hair))
    initialise_colours(model, Strands(torch.zeros(0, 6, 3)), targets)
    seen = cover * dark + 1 - cover
    own = model.body.colour.detach().flatten(0, 1)[model.body.atlas.texels().texel]
    # With the hair's true colour, what remains of the hair is the weight with which a pixel counts as it is.
    left = AS_SEEN / (1 - cover + AS_SEEN)
    assert ((1 - own) / (1 - seen)).mean() == pytest.approx(left, abs=0.15)


@pytest.mark.parametrize("matte", [0.97, None])
def test_hair_does_not_colour_the_background_behind_it(scene, matte):
    """Neither where a matte is not quite 1 nor where there is no mask at all."""
    model, strands, cameras = scene
    # The slab would hide the background.
    model.body.vertices += 10.0
    targets = [painted(model, strands, camera, torch.zeros(STRANDS, 3)) for camera in cameras]
    initialise_colours(model, strands, [masked(target, matte) for target in targets])
    torch.testing.assert_close(model.background.colour, BLUE.expand_as(model.background.colour))


def bare(body: Mesh) -> torch.Tensor:
    """What `colours_under_hair` returns where nothing grows."""
    return torch.zeros(len(body.vertices), 4)


def masked(target: View, matte: float | None) -> View:
    """The hair mask made fainter, or taken away."""
    return replace(target, hair_mask=None if matte is None or target.hair_mask is None else matte * target.hair_mask)
