from dataclasses import replace

import pytest
import torch

from neural_strands.fitting.strand_width import FINER, WIDTHS, estimate_width
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View
from neural_strands.model.compositing import area_mean
from neural_strands.model.hair_model import HairModel, HairModelConfig
from neural_strands.model.unet import UNetConfig
from neural_strands.prior.generator import StrandGenerator
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.scalp.roots import Roots


def hair_model(tip=0.0):
    empty = Mesh(torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int64))
    roots = Roots(torch.zeros(1, 3), torch.full((1, 2), 0.5), torch.eye(3)[None], torch.zeros(1))
    config = HairModelConfig(unet=UNetConfig((4, 4)), lines=LineConfig(tip=tip))
    return HairModel(config, roots, StrandGenerator(), empty, torch.Generator().manual_seed(0))


def matted(strands, lines, factor=10):
    """Views of strands whose masks are their coverage, drawn far more finely than the model draws."""
    for eye in ((0.0, 0.1, 0.5), (0.5, 0.0, 0.1)):
        camera = Camera.look_at(torch.tensor(eye), torch.zeros(3), 700.0, (160, 160))
        fine = camera.resized(camera.width * factor, camera.height * factor)
        drawn = rasterise_lines(strands, fine, config=lines).segment >= 0
        mask = area_mean(drawn[..., None].float(), factor)[..., 0]
        yield View(camera, torch.zeros(*mask.shape, 3), mask)


@pytest.mark.parametrize("tip", [0.0, 0.4])
@pytest.mark.parametrize("width", [WIDTHS[2], WIDTHS[5]])
def test_the_width_of_the_masks_is_found(generator, width, tip):
    """Sparse strands, a few hairs wide: their mattes determine how wide they are."""
    start = torch.randn(150, 1, 3, generator=generator) * 0.05
    strands = start + (torch.randn(150, 1, 3, generator=generator) * 0.08) * torch.linspace(0, 1, 30)[:, None]
    lines = LineConfig(width=width, tip=tip)
    found = estimate_width(hair_model(tip), Strands(strands), list(matted(strands, lines)))
    assert found == pytest.approx(width, rel=0.25)


def test_without_masks_strands_stay_as_they_are_drawn(generator):
    model = hair_model()
    model.strand_width = 3e-4
    strands = torch.randn(20, 10, 3, generator=generator) * 0.05
    targets = [replace(target, hair_mask=None) for target in matted(strands, LineConfig(width=1e-3), 1)]
    assert estimate_width(model, Strands(strands), targets) == 3e-4
    assert estimate_width(model, Strands(strands), []) == 3e-4


def test_lines_one_pixel_wide_stay_where_masks_are_made_of_them(generator):
    """In coarse pictures, few strands represent many hairs, which cover more than strands as wide as a hair can."""
    model = hair_model()
    start = torch.randn(150, 1, 3, generator=generator) * 0.05
    strands = start + (torch.randn(150, 1, 3, generator=generator) * 0.08) * torch.linspace(0, 1, 30)[:, None]
    targets = list(matted(strands, LineConfig(width=4e-3), 3))
    assert estimate_width(model, Strands(strands), targets) == WIDTHS[-1] * FINER
    targets = list(matted(strands, LineConfig(), model.config.supersample))
    assert estimate_width(model, Strands(strands), targets) == 0.0
