"""The whole model: shapes, gradients, crops, files, and views that show nothing."""

import json
import math
from dataclasses import replace

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.geometry.strands import Strands
from neural_strands.model import hair_model
from neural_strands.model.compositing import (
    between_lines,
    filled_from_coarser,
    hair_rectangle,
    near_hair,
    surrounding_odds,
)
from neural_strands.model.files import load_hair_model, save_hair_model
from neural_strands.model.hair_model import (
    LEAST_OPACITY,
    MOST_OPACITY,
    HairModel,
    HairModelConfig,
)
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.surround.body import START, SurroundConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.lines import LineConfig
from neural_strands.raster.openings import openings
from neural_strands.raster.splat import MINIMUM_WEIGHT, splat_pyramid
from neural_strands.scalp.roots import Roots

ROOTS = 60


def config(**changes) -> HairModelConfig:
    return HairModelConfig(
        ScalpTextureConfig(shape_size=8, appearance_size=8, appearance_channels=4),
        UNetConfig(widths=(8, 8, 8)),
        SurroundConfig(body_texture=8, background_texture=4, background_directions=6),
        points=12,
        **changes,
    )


def disc_roots(count: int = ROOTS) -> Roots:
    """Roots on a disc of 5 cm radius in the plane y = 0, their normals up."""
    k = torch.arange(count) + 0.5
    radius, angle = 0.05 * (k / max(count, 1)).sqrt(), 2.4 * k
    position = torch.stack([radius * angle.cos(), 0 * k, radius * angle.sin()], dim=1)
    uv = 0.5 + 8 * position[:, [0, 2]]
    frame = torch.tensor([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]).T.expand(count, 3, 3).contiguous()
    return Roots(position, uv, frame, torch.zeros(count))


def slab() -> Mesh:
    """A square of 10 cm under the roots, facing up."""
    vertices = torch.tensor(
        [[-0.05, -0.001, -0.05], [0.05, -0.001, -0.05], [0.05, -0.001, 0.05], [-0.05, -0.001, 0.05]]
    )
    faces = torch.tensor([[0, 2, 1], [0, 3, 2]])
    return Mesh(vertices, faces)


def model(body: Mesh | None = None, roots: int = ROOTS, **changes) -> HairModel:
    random = torch.Generator().manual_seed(0)
    generator = StrandGenerator()
    with torch.no_grad():
        for parameter in generator.parameters():
            parameter += 0.05 * torch.randn(parameter.shape, generator=random)
    made = HairModel(config(**changes), disc_roots(roots), generator, slab() if body is None else body, random)
    with torch.no_grad():
        made.textures.shape.normal_(generator=random)
        made.textures.appearance.normal_(generator=random)
    return made


def view(size: tuple[int, int] = (48, 40), eye: tuple[float, float, float] = (0.0, 0.5, 0.5)) -> Camera:
    return Camera.look_at(torch.tensor(eye), torch.zeros(3), 180.0, size)


def stubble(hair: HairModel, length: float = 0.02) -> Strands:
    """Straight strands along the normals."""
    along = torch.linspace(0, length, 12)[:, None] * hair.root_frame[:, None, :, 2]
    return Strands(hair.root_position[:, None] + along, root_uv=hair.root_uv)


@pytest.mark.parametrize("size", [(48, 40), (37, 29), (5, 64), (1, 1)])
@pytest.mark.parametrize("supersample", [1, 2])
def test_any_image_size(size, supersample):
    hair = model(supersample=supersample)
    output = hair(view(size))
    assert output.rgb.shape == (size[1], size[0], 3)
    assert output.alpha.shape == output.coverage.shape == (size[1], size[0])
    for image in (output.rgb, output.alpha, output.hair_rgb, output.behind_rgb):
        assert image.isfinite().all()
    assert 0 <= output.alpha.min() <= output.alpha.max() <= 1


def test_pictures_without_gradients_are_rounded_where_that_is_faster(monkeypatch):
    """But never pictures with gradients, nor those of a model without mixed precision, from which scores come."""
    hair, exact_hair = model(), model(mixed_precision=False)
    pictures = {}
    for is_faster in (False, True):
        monkeypatch.setattr(hair_model, "has_bfloat16_matrices", lambda is_faster=is_faster: is_faster)
        with torch.no_grad():
            pictures[is_faster] = hair.render(stubble(hair), view()).rgb
            exact = exact_hair.render(stubble(exact_hair), view()).rgb
        assert torch.equal(exact, pictures[False])
        assert torch.equal(hair.render(stubble(hair), view()).rgb, exact)
    assert 1e-6 < (pictures[True] - pictures[False]).abs().max() < 1 / 255


def test_pixels_far_from_hair_need_not_be_computed(monkeypatch):
    # Hair in one corner of a large view, with and without the rest of the image generator's input.
    hair = model()
    camera = view((256, 192)).cropped(40, 50, 256, 192)
    near = hair.render(stubble(hair), camera)
    seen: list[Rectangle] = []
    whole = Rectangle(0, 0, 256, 192)
    monkeypatch.setattr(hair_model, "hair_rectangle", lambda *given: seen.append(hair_rectangle(*given)) or whole)
    complete = hair.render(stubble(hair), camera)
    assert seen[0].width * seen[0].height < 0.6 * 256 * 192
    assert complete.alpha.max() > 0.2
    torch.testing.assert_close(near.alpha, complete.alpha, atol=1e-4, rtol=0)
    torch.testing.assert_close(near.rgb, complete.rgb, atol=1e-4, rtol=0)


def test_opacity_starts_from_coverage():
    hair = model(supersample=1)
    with torch.no_grad():
        hair.unet.output.zero_()
    output = hair.render(stubble(hair), view((96, 80)))
    odds = torch.logit(output.coverage.clamp(LEAST_OPACITY, MOST_OPACITY)) + surrounding_odds(output.coverage)
    start = odds.sigmoid() * near_hair(output.coverage)
    assert torch.allclose(output.alpha, start, atol=1e-5)
    assert output.alpha.min() == 0
    assert output.alpha[output.coverage == 0].max().item() == pytest.approx(LEAST_OPACITY, rel=1e-4)
    assert output.coverage.max() > MOST_OPACITY


def test_without_a_correction_the_picture_is_that_of_a_network_that_answers_zero():
    silent, plain = model(), model()
    plain.config = replace(plain.config, unet=replace(plain.config.unet, corrects=False))
    with torch.no_grad():
        silent.unet.output.zero_()
        plain.unet.bias.fill_(1.0)
    expected, found = (hair.render(stubble(hair), view((96, 80))) for hair in (silent, plain))
    torch.testing.assert_close(found.rgb, expected.rgb, atol=1e-5, rtol=0)
    torch.testing.assert_close(found.alpha, expected.alpha, atol=1e-5, rtol=0)
    found.rgb.square().sum().backward()
    assert plain.textures.appearance.grad is not None
    assert plain.textures.appearance.grad.abs().sum() > 0
    assert all(parameter.grad is None for parameter in plain.unet.parameters())


def test_gradients_reach_both_textures_and_what_can_be_seen():
    hair = model()
    hair(view()).rgb.square().sum().backward()
    for name in ("textures.shape", "textures.appearance", "body.colour", "unet.output"):
        gradient = hair.get_parameter(name).grad
        assert gradient is not None, name
        assert gradient.abs().sum() > 0, name
    assert all(parameter.grad is None for parameter in hair.generator.parameters())


def test_no_gradient_reaches_hidden_strands():
    hair = model()
    points = stubble(hair).points.detach()
    points[: ROOTS // 2, :, 1] -= 0.2  # under the slab
    points.requires_grad_()
    uv = torch.cat([torch.full((ROOTS // 2, 2), 0.1), torch.full((ROOTS // 2, 2), 0.9)])
    hair.render(Strands(points, root_uv=uv), view()).rgb.square().sum().backward()
    assert points.grad[: ROOTS // 2].abs().sum() == 0
    assert points.grad[ROOTS // 2 :].abs().sum() > 0
    texels = hair.textures.appearance.grad.abs().sum(dim=-1)
    assert texels[:4, :4].sum() == 0
    assert texels[4:, 4:].sum() > 0


def test_a_crop_is_the_same_pixels():
    hair, camera = model(), view((96, 80))
    strands = stubble(hair)
    whole = hair.render(strands, camera)
    left, top, width, height = 16, 8, 64, 64
    part = hair.render(strands, camera.cropped(left, top, width, height))
    inner = (slice(16, -16), slice(16, -16))
    for name in ("alpha", "coverage", "behind_rgb", "rgb"):
        expected = getattr(whole, name)[top : top + height, left : left + width][inner]
        torch.testing.assert_close(getattr(part, name)[inner], expected, atol=2e-3, rtol=0, msg=name)


def test_a_hair_model_without_hair_shows_what_lies_behind():
    hair = model(roots=0)
    output = hair(view())
    assert output.coverage.sum() == 0
    assert (output.lines.segment < 0).all()
    assert output.rgb.isfinite().all()


def test_a_camera_that_looks_away_sees_the_background():
    hair = model()
    away = Camera.look_at(torch.tensor([0.0, 0.5, 0.5]), torch.tensor([0.0, 1.0, 1.0]), 180.0, (32, 24))
    output = hair(away)
    assert output.coverage.sum() == 0
    torch.testing.assert_close(output.behind_rgb, torch.full((24, 32, 3), START))


def test_strands_that_are_not_finite_are_not_drawn():
    hair = model()
    strands = stubble(hair)
    strands.points[::2] = math.nan
    output = hair.render(strands, view())
    drawn = output.lines.segment[output.lines.segment >= 0] // 11
    assert len(drawn) > 0
    assert (drawn % 2 == 1).all()
    assert output.rgb.isfinite().all()


def test_strands_without_a_place_on_the_scalp_are_refused():
    hair = model()
    with pytest.raises(ValueError, match="root_uv"):
        hair.render(Strands(stubble(hair).points), view())


def test_saved_and_loaded_is_the_same_model(tmp_path):
    hair = model(slab(), lines=LineConfig(width=0.001, tip=0.3))
    folder = tmp_path / "hair"
    hair.strand_width = 0.004
    save_hair_model(hair, folder, {"seed": "0"})
    again = load_hair_model(folder)
    assert again.config == hair.config
    assert again.lines == hair.lines == replace(hair.config.lines, width=0.004)
    torch.testing.assert_close(again.state_dict(), hair.state_dict(), rtol=0, atol=0)
    torch.testing.assert_close(again(view()).rgb, hair(view()).rgb, rtol=0, atol=0)
    assert sorted(path.name for path in folder.iterdir()) == ["config.json", "model.safetensors"]


def test_folders_that_are_no_model_are_refused_in_one_sentence(tmp_path):
    with pytest.raises(InputError, match=r"found no config\.json"):
        load_hair_model(tmp_path)
    folder = tmp_path / "hair"
    save_hair_model(model(), folder)
    whole = (folder / "model.safetensors").read_bytes()
    (folder / "model.safetensors").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="expected a complete hair model"):
        load_hair_model(folder)
    (folder / "model.safetensors").write_bytes(whole)
    described = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**described, "format": 99}))
    with pytest.raises(InputError, match="format: expected 12, found 99; use the version"):
        load_hair_model(folder)
    described["model"]["surprise"] = 1
    (folder / "config.json").write_text(json.dumps(described))
    with pytest.raises(InputError, match="surprise"):
        load_hair_model(folder)


def test_the_image_is_hair_over_body_over_background():
    hair = model()
    with torch.no_grad():
        hair.body.colour.fill_(0.8)
        hair.background.colour.fill_(0.2)
    output = hair.render(stubble(hair), view())
    expected = output.alpha[..., None] * output.hair_rgb + (1 - output.alpha[..., None]) * output.behind_rgb
    torch.testing.assert_close(to_linear(output.rgb), expected)
    assert output.behind_rgb.min().item() == pytest.approx(0.2, abs=1e-5)
    assert output.behind_rgb.max().item() == pytest.approx(0.8, abs=1e-5)


def test_the_body_learns_where_it_is_told_to(generator):
    hair, camera = model(supersample=1), view((96, 80))
    weight = torch.rand(80, 96, generator=generator)
    plain, output = hair.render(stubble(hair), camera), hair.render(stubble(hair), camera, body_weight=weight)
    assert torch.equal(output.rgb, plain.rgb)
    alpha, seen = output.alpha.detach()[..., None], openings(output.body_depth, output.lines.segment, 1)
    _, skin = between_lines(hair.body(camera).colour, seen)
    for rendered, share in ((output, weight[..., None]), (plain, torch.ones(80, 96, 1))):
        (found,) = torch.autograd.grad(to_linear(rendered.rgb).sum(), hair.body.colour)
        (expected,) = torch.autograd.grad((skin * share * (1 - alpha)).sum(), hair.body.colour, retain_graph=True)
        assert expected.abs().sum() > 0
        torch.testing.assert_close(found, expected)


def test_gaps_show_the_next_coarser_map(generator):
    pixels, colours = torch.rand(30, 2, generator=generator) * 32, torch.full((30, 3), 0.7)
    maps = splat_pyramid(pixels, colours, (31, 33), 5)
    image = filled_from_coarser([m.features for m in maps], [m.coverage for m in maps])
    whole = maps[0].coverage >= MINIMUM_WEIGHT
    assert whole.float().mean() < 0.2
    torch.testing.assert_close(image[:, whole], maps[0].features[:, whole])
    assert (image > 0.5).all()
    assert (image < 0.7 + 1e-5).all()
