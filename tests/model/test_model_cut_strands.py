"""Strands cut in half and resampled look as before in their remaining part, because t is preserved."""

from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.resample import resample
from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.hair_volume import hair_volume
from neural_strands.model.outputs import RenderOutput
from neural_strands.model.scalp_textures import ScalpTextureConfig
from neural_strands.model.shading import ShadingConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.lines import LineConfig
from neural_strands.scalp.roots import Roots

STRANDS, POINTS = 400, 101
AWAY = 8
"""Rows above the cut that the image generator mixes with what lies below it."""


@pytest.fixture
def model(generator) -> HairModel:
    """Strands that get thinner over more than their outer half, with four random colours along each, and no body."""
    place = torch.rand(STRANDS, 2, generator=generator)
    position = torch.stack([0.1 * place[:, 0] - 0.05, torch.zeros(STRANDS), 0.1 * place[:, 1] - 0.05], dim=1)
    config = HairModelConfig(
        ScalpTextureConfig(shape_size=4, appearance_size=64, appearance_channels=4, appearance_knots=4),
        UNetConfig(widths=(8, 8, 8)),
        shading=ShadingConfig(hidden=16),
        lines=LineConfig(width=5e-4, tip=0.6),
        points=POINTS,
    )
    roots = Roots(position, place, torch.eye(3).expand(STRANDS, 3, 3), torch.zeros(STRANDS))
    nobody = Mesh(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int64))
    hair = HairModel(config, roots, StrandGenerator(), nobody, generator)
    with torch.no_grad():
        hair.textures.appearance.normal_(generator=generator)
        hair.shading.outer.normal_(std=0.1, generator=generator)
    return hair


def hanging(model: HairModel, points: int) -> Strands:
    """Straight strands, each leaning another way, evenly sampled."""
    lean = 0.02 * torch.randn(STRANDS, 1, 3, generator=torch.Generator().manual_seed(1))
    fall = lean * torch.tensor([1.0, 0.0, 1.0]) + torch.tensor([0.0, -0.2, 0.0])
    along = torch.linspace(0, 1, points)[:, None] * fall
    return Strands(model.root_position[:, None] + along, root_uv=model.root_uv)


def halves(strands: Strands) -> Strands:
    """The half of each strand nearer its root, with its t, resampled to as many points as the whole strand has."""
    kept = strands.points_per_strand // 2 + 1
    half = replace(strands, points=strands.points[:, :kept], t=strands.parameters()[:, :kept])
    return resample(half, strands.points_per_strand)


@pytest.fixture
def camera() -> Camera:
    middle = torch.tensor([0.0, -0.1, 0.0])
    return Camera.look_at(middle + torch.tensor([0.0, 0.0, 1.0]), middle, 700.0, (128, 176))


def above_the_cut(camera: Camera, cut: Strands) -> int:
    """Rows of the image that show nothing near the cuts; over most of them lie strands."""
    rows = camera.project(cut.points)[0][..., 1]
    last = int(rows[:, -1].min()) - AWAY
    assert last - float(rows[:, 0].min()) > 50
    return last


def differences(one: RenderOutput, other: RenderOutput, rows: int) -> dict[str, torch.Tensor]:
    return {name: (getattr(one, name) - getattr(other, name))[:rows] for name in ("rgb", "alpha")}


def test_what_remains_of_cut_strands_looks_as_before(model, camera):
    """The oracle is the whole hair, sampled twice as densely: where the cut hair remains, it has the same points.

    Sampled as it was, a pixel gathers twice as long parts of strands, so that images agree but for that.
    """
    whole, fine = hanging(model, POINTS), hanging(model, 2 * POINTS - 1)
    cut, volume = halves(whole), hair_volume(whole.points)
    rows = above_the_cut(camera, cut)
    with torch.no_grad():
        now, exact, before, tips = (
            model.render(strands, camera, volume=volume) for strands in (cut, fine, whole, replace(cut, t=None))
        )
    assert (before.coverage[:rows] > 0.5).float().mean() > 0.2
    for name, difference in differences(now, exact, rows).items():
        assert difference.abs().max() < 2e-3, name
    for name, difference in differences(now, before, rows).items():
        assert difference.square().mean().sqrt() < 0.05, name
    # If they were taken for whole strands, the halves would have the colours and the widths of tips.
    assert differences(now, tips, rows)["rgb"].square().mean().sqrt() > 0.1
    assert differences(now, tips, rows)["alpha"].square().mean().sqrt() > 0.05


def test_gradients_of_cut_strands_are_those_of_whole_ones(model, camera):
    """To the appearance, and to a move of each strand across the image.

    Along the strands it is no oracle: points in the middle of a pixel's rows lie at the kink of the bilinear weights.
    """
    whole, fine = hanging(model, POINTS), hanging(model, 2 * POINTS - 1)
    cut, volume = halves(whole), hair_volume(whole.points)
    rows = above_the_cut(camera, cut)
    random = torch.randn(rows, camera.width, 3, generator=torch.Generator().manual_seed(2))
    found = []
    for strands in (cut, fine):
        points = strands.points.clone().requires_grad_()
        output = model.render(replace(strands, points=points), camera, volume=volume)
        loss = (output.rgb[:rows] * random).sum()
        texels, at_points = torch.autograd.grad(loss, [model.textures.appearance, points])
        found.append((texels, at_points[..., 0].sum(dim=1)))
    for mine, theirs in zip(*found, strict=True):
        assert theirs.abs().sum() > 0
        assert (mine - theirs).norm() < 0.02 * theirs.norm()
