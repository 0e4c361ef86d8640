"""Changes length, curl, wave and volume through the corresponding quantities of the strand prior.

The traversal of the prior finds length, curliness and bend along directions of its latent space. The generator's own
quantities (`prior.generator.Raw`) separate them further: length, the amplitude, frequency and phase of the curl, and
the heading. These are changed here and converted back to latents, so that the result is a texture again.

A helix of radius r and pitch p adds 2 pi r / p strand lengths to dp/dt, on two axes across the strand, a quarter turn
apart; a wave adds to one axis only. The length that a curl adds to the curve is taken from its extent.
"""

import math
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.hair import ScalpShape
from neural_strands.editing.region import checked_weight, region_weight
from neural_strands.editing.settings import Restyle
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.frames import orthonormal_frames
from neural_strands.model.hair_model import HairModel
from neural_strands.prior.bounded_quantities import length_from_raw, logit_between, raw_from_length
from neural_strands.prior.generator import LARGEST_GAIN, Raw, StrandGenerator
from neural_strands.prior.modulator import CouplingModulator

CURL_PITCH, CURL_SLOPE = 0.045, 1.3
"""Length of a turn of a curl, metres, and 2 pi radius / pitch of a curl of 1."""
WAVE_PITCH, WAVE_SLOPE = 0.07, 0.8
"""The same for a wave."""
LOCK = 0.1
"""Size of the locks whose curls are in phase, in the chart's unit."""
RAISED = math.radians(20.0)
"""Angle by which a volume of 1 raises the headings of strands, radians."""
FLATTEST = math.radians(150.0)
"""Largest angle of a heading with the scalp's normal after volume is reduced, radians."""
TINY = 1e-4
"""Least amplitude of a curl, as a share of the largest."""
BLOCK = 16384
"""Number of texels restyled together, to bound memory."""


@torch.no_grad()
def restyle(style: Restyle, shape: ScalpShape, model: HairModel) -> ScalpShape:
    """Restyle the texture; the roots stay the same.

    Raises:
        InputError: the painted region has no roots, or the model's generator cannot be inverted.
    """
    check_invertible(model.generator, "restyle")
    if style.region:
        checked_weight(region_weight(shape.uv, style.region), "restyle")
    rows, columns, _ = shape.texture.shape
    uv = texel_centres(rows, columns).to(shape.texture)
    weight = region_weight(uv, style.region)
    phase = lock_phases(uv, style.seed)
    flat = shape.texture.reshape(rows * columns, -1)
    parts = [
        _restyled(style, model.generator, *block)
        for block in zip(flat.split(BLOCK), weight.split(BLOCK), phase.split(BLOCK), strict=True)
    ]
    return replace(shape, texture=torch.cat(parts).reshape(shape.texture.shape))


def check_invertible(generator: StrandGenerator, edit: str) -> None:
    """Refuse a generator whose quantities cannot be converted back to latents.

    Raises:
        InputError: its modulator is the paper's MLP.
    """
    if not isinstance(generator.modulator, CouplingModulator):
        raise InputError(
            f"{edit}: expected a model with the coupling modulator, found the paper's MLP, which has no inverse; fit "
            "with the prior that ships with the package."
        )


def texel_centres(rows: int, columns: int) -> Float[Tensor, "texel 2"]:
    """Chart coordinates of the texels, row by row."""
    v, u = torch.meshgrid((torch.arange(rows) + 0.5) / rows, (torch.arange(columns) + 0.5) / columns, indexing="ij")
    return torch.stack([u, v], dim=-1).reshape(-1, 2)


def lock_phases(uv: Float[Tensor, "texel 2"], seed: int) -> Float[Tensor, " texel"]:
    """Angles, radians, that vary from lock to lock: a sum of waves in random directions over the chart."""
    random = torch.Generator().manual_seed(seed)
    turn, start = 2 * math.pi * torch.rand(2, 6, generator=random)
    waves = torch.stack([turn.cos(), turn.sin()]) * (2 * math.pi / LOCK) * torch.linspace(0.3, 1.0, 6)
    return 0.8 * torch.sin(uv @ waves.to(uv) + start.to(uv)).sum(dim=1)


def _restyled(
    style: Restyle,
    generator: StrandGenerator,
    latent: Float[Tensor, "texel latent"],
    weight: Float[Tensor, " texel"],
    phase: Float[Tensor, " texel"],
) -> Float[Tensor, "texel latent"]:
    """Latents of restyled strands; where the weight is 0, unchanged except for rounding."""
    raw = generator.raw(latent)
    length = length_from_raw(raw.length) * style.length**weight
    raw = replace(raw, length=raw_from_length(length), smooth=raised(raw.smooth, weight * style.volume * RAISED))
    if style.curl < 0:
        gain = raw.gain.sigmoid() * (1 + style.curl * weight)
        raw = replace(raw, gain=torch.logit(gain.clamp(TINY, 1 - TINY)))
    for amount, pitch, slope, flat in (
        (style.curl, CURL_PITCH, CURL_SLOPE, False),
        (style.wave, WAVE_PITCH, WAVE_SLOPE, True),
    ):
        if amount > 0:
            raw = _curled(generator, raw, amount * slope * weight, length / pitch, phase, flat)
    changed, _ = generator.latent(raw.flat())
    return torch.where(weight[:, None] > 0, changed, latent)


def raised(
    smooth: Float[Tensor, "strand 3 smooth"], angle: Float[Tensor, " strand"]
) -> Float[Tensor, "strand 3 smooth"]:
    """Rotate headings towards the scalp's normal by an angle, radians.

    The radius of the stereographic projection is the tangent of half the angle with the normal (`prior.heading`).
    """
    radius = smooth[:, :2, 0].norm(dim=1).clamp(min=1e-9)
    now = 2 * torch.atan(radius)
    wanted = (now - angle).clamp(min=0.0).minimum(now.clamp(min=FLATTEST))
    changed = smooth.clone()
    changed[:, :2, 0] *= (torch.tan(wanted / 2) / radius)[:, None]
    return changed


def _curled(
    generator: StrandGenerator,
    raw: Raw,
    slope: Float[Tensor, " strand"],
    turns: Float[Tensor, " strand"],
    phase: Float[Tensor, " strand"],
    flat: bool,
) -> Raw:
    """Replace the curl of strands by a helix or a flat wave; where `slope` is 0, they stay unchanged."""
    layer = generator.synthesiser
    low, high = generator.frequency_bounds()
    # The two units of a sideband are a quarter turn apart.
    sine, cosine = layer.config.sidebands, layer.config.sidebands + 1
    frequency = (2 * math.pi * turns - layer.unit_frequency[sine]).clamp(1.001 * low, 0.999 * high)
    first, second = _axes_across(raw.smooth)
    unit = torch.zeros_like(raw.unit)
    unit[..., sine] = first * phase.cos()[:, None] - (0.0 if flat else 1.0) * second * phase.sin()[:, None]
    unit[..., cosine] = first * phase.sin()[:, None] + (0.0 if flat else 1.0) * second * phase.cos()[:, None]
    size = unit.square().mean(dim=(1, 2)).sqrt().clamp(min=1e-9)
    gain = (slope * size / LARGEST_GAIN).clamp(TINY, 1 - TINY)
    # A helix of slope a is sqrt(1 + a^2) times as long as its axis, a wave on average as half that square.
    stretch = (1 + slope.square() * (0.5 if flat else 1.0)).sqrt()
    curled = replace(
        raw,
        length=raw_from_length(length_from_raw(raw.length) / stretch),
        gain=torch.logit(gain),
        frequency=logit_between(frequency, low, high),
        warp=torch.zeros_like(raw.warp),
        unit=unit / size[:, None, None],
    )
    had = (slope > 0).to(slope)
    mixed = torch.lerp(raw.flat(), curled.flat(), had[:, None])
    return generator.split(mixed)


def _axes_across(
    smooth: Float[Tensor, "strand 3 smooth"],
) -> tuple[Float[Tensor, "strand 3"], Float[Tensor, "strand 3"]]:
    """Two unit directions across the heading of each strand."""
    east, north = smooth[:, 0, 0], smooth[:, 1, 0]
    squared = east * east + north * north
    heading = torch.stack([2 * east, 2 * north, 1 - squared], dim=1) / (1 + squared)[:, None]
    frames = orthonormal_frames(heading, heading.new_tensor([1.0, 0.0, 0.0]).expand_as(heading))
    return frames[:, :, 0], frames[:, :, 1]
