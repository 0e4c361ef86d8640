"""Shapes of two runs: mixed, or one run's shape on the other's head."""

from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.region import checked_weight, region_weight
from neural_strands.editing.restyle import texel_centres
from neural_strands.editing.settings import Blend, Dabs, Transfer
from neural_strands.foundation.errors import InputError
from neural_strands.model.files import find_hair_model, load_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.texture import sample_texture


def blend(settings: Blend, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """The texture between this one and another run's.

    Raises:
        InputError: the other run cannot be read or has another strand prior, or the painted region holds no root.
    """
    return _mixed(shape, model, settings.other, settings.share, settings.region, "blend")


def transfer(settings: Transfer, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """The other run's texture; places of the chart correspond.

    Raises:
        InputError: the other run cannot be read, or has another strand prior.
    """
    return _mixed(shape, model, settings.other, 1.0, (), "transfer")


@torch.no_grad()
def _mixed(shape: ScalpShape, model: HairModel, path: str, share: float, region: Dabs, edit: str) -> ScalpShape:
    other = load_hair_model(find_hair_model(Path(path)), shape.texture.device)
    _check_same_generator(model, other, path, edit)
    if region:
        checked_weight(region_weight(shape.uv, region), edit)
    rows, columns, channels = shape.texture.shape
    uv = texel_centres(rows, columns).to(shape.texture)
    theirs: Float[Tensor, "texel latent"] = sample_texture(other.textures.shape, uv)
    weight = share * region_weight(uv, region)
    mixed = torch.lerp(shape.texture.reshape(-1, channels), theirs, weight[:, None])
    return replace(shape, texture=mixed.reshape(shape.texture.shape))


def _check_same_generator(model: HairModel, other: HairModel, path: str, edit: str) -> None:
    ours, theirs = model.generator.state_dict(), other.generator.state_dict()
    if ours.keys() != theirs.keys() or any(not torch.equal(ours[name], theirs[name].to(ours[name])) for name in ours):
        raise InputError(
            f"{edit}: {path}: expected a run with the same strand prior, found another; fit both with one prior."
        )
