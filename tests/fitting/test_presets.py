"""Presets: a shape texture that tells its strands apart."""

import math
from typing import get_args

import pytest
import torch

from neural_strands.fitting.config import Preset, preset
from neural_strands.fitting.first_strands import texture_from_latents
from neural_strands.raster.texture import sample_texture

ROOTS = 500


def residual(texels: float, generator: torch.Generator) -> float:
    """What a texture loses of unrelated latents, relative to their size; the chart fills a disc of the square."""
    angle, radius = 2 * math.pi * torch.rand(ROOTS, generator=generator), torch.rand(ROOTS, generator=generator).sqrt()
    uv = 0.5 + 0.48 * radius[:, None] * torch.stack([angle.cos(), angle.sin()], dim=1)
    latents = torch.randn(ROOTS, 3, generator=generator)
    texture = texture_from_latents(uv, latents, round(math.sqrt(texels * ROOTS)))
    return float((sample_texture(texture, uv) - latents).norm() / latents.norm())


@pytest.mark.parametrize("name", get_args(Preset))
def test_the_shape_texture_tells_the_strands_of_a_preset_apart(name, generator):
    config = preset(name)
    texels = config.model.textures.shape_size**2 / config.strands
    kept, coarse = residual(texels, generator), residual(texels / 4, generator)
    assert kept < 0.2 < coarse
