"""Combines the shapes of two runs: mixes them, or puts one run's shape on the other's head."""

import math
from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.region import checked_weight, region_weight
from neural_strands.editing.restyle import BLOCK, texel_centres
from neural_strands.editing.settings import Blend, Dabs, Transfer
from neural_strands.foundation.errors import InputError
from neural_strands.model.files import find_hair_model, load_hair_model
from neural_strands.model.hair_model import HairModel
from neural_strands.prior.generator import Raw, StrandGenerator
from neural_strands.prior.modulator import CouplingModulator
from neural_strands.raster.texture import sample_texture


def blend(settings: Blend, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """Mix this shape with another run's.

    Raises:
        InputError: the other run cannot be read or has another strand prior, or the painted region has no roots.
    """
    return _mixed(shape, model, settings.other, settings.share, settings.region, "blend")


def transfer(settings: Transfer, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """Take the other run's texture, at the same chart coordinates.

    Raises:
        InputError: the other run cannot be read, or has another strand prior.
    """
    return _mixed(shape, model, settings.other, 1.0, (), "transfer")


@torch.no_grad()
def _mixed(shape: ScalpShape, model: HairModel, path: str, share: float, region: Dabs, edit: str) -> ScalpShape:
    if not Path(path).exists():
        raise InputError(f"{edit}: {path}: expected another run or its model, found nothing there; check the path.")
    other = load_hair_model(find_hair_model(Path(path)), shape.texture.device)
    _check_same_generator(model, other, path, edit)
    if region:
        checked_weight(region_weight(shape.uv, region), edit)
    rows, columns, channels = shape.texture.shape
    uv = texel_centres(rows, columns).to(shape.texture)
    theirs: Float[Tensor, "texel latent"] = sample_texture(other.textures.shape, uv)
    weight = share * region_weight(uv, region)
    parts = zip(*(each.split(BLOCK) for each in (shape.texture.reshape(-1, channels), theirs, weight)), strict=True)
    mixed = torch.cat([between(model.generator, *part) for part in parts])
    return replace(shape, texture=mixed.reshape(shape.texture.shape))


def between(
    generator: StrandGenerator,
    ours: Float[Tensor, "strand latent"],
    theirs: Float[Tensor, "strand latent"],
    share: Float[Tensor, " strand"],
) -> Float[Tensor, "strand latent"]:
    """Interpolate latents of strands, with headings rotating about the scalp's normal.

    Halfway between the latents of strands with opposite headings is a strand that stands off the scalp. So both are
    first rotated about the normal to the same heading, then mixed, then rotated to the heading in between, the shorter
    way round. If the generator has no inverse, the latents themselves are mixed, as in the paper.

    Args:
        generator: the generator that decodes both.
        ours: latents at share 0.
        theirs: latents at share 1.
        share: share of `theirs`, from 0 to 1; at both ends the latents are returned unchanged.
    """
    inner = (share > 0) & (share < 1)
    if not isinstance(generator.modulator, CouplingModulator) or not inner.any():
        return torch.lerp(ours, theirs, share[:, None])
    first, second = generator.raw(ours), generator.raw(theirs)
    start, end = azimuth(first), azimuth(second)
    way = torch.remainder(end - start + math.pi, 2 * math.pi) - math.pi
    aligned = torch.lerp(first.flat(), turned(second, start - end).flat(), share[:, None])
    mixed, _ = generator.latent(turned(generator.split(aligned), share * way).flat())
    return torch.where(inner[:, None], mixed, torch.where(share[:, None] > 0, theirs, ours))


def azimuth(raw: Raw) -> Float[Tensor, " strand"]:
    """Angle of headings about the scalp's normal, radians."""
    return torch.atan2(raw.smooth[:, 1, 0], raw.smooth[:, 0, 0])


def turned(raw: Raw, angle: Float[Tensor, " strand"]) -> Raw:
    """Rotate strands about the scalp's normal by an angle, radians."""
    cosine, sine = angle.cos()[:, None], angle.sin()[:, None]

    def about_normal(values: Float[Tensor, "strand 3 weight"]) -> Float[Tensor, "strand 3 weight"]:
        east, north, up = values.unbind(dim=1)
        return torch.stack([cosine * east - sine * north, sine * east + cosine * north, up], dim=1)

    return replace(raw, unit=about_normal(raw.unit), smooth=about_normal(raw.smooth))


def _check_same_generator(model: HairModel, other: HairModel, path: str, edit: str) -> None:
    ours, theirs = model.generator.state_dict(), other.generator.state_dict()
    if ours.keys() != theirs.keys() or any(not torch.equal(ours[name], theirs[name].to(ours[name])) for name in ours):
        raise InputError(
            f"{edit}: {path}: expected a run with the same strand prior, found another; fit both with one prior."
        )
