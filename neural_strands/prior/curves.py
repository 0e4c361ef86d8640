"""Synthetic hair curves: the training data of the strand prior (paper, "Training Data").

Each curve is a strand in its root's local frame (tangent, bitangent, normal; metres; root at 0), at points equally
spaced in arc length. A curve has a smooth base, which leaves the scalp at some tilt, is pulled towards a random "down",
bends, and is jittered at its control points like an artist's spline. An offset is wound around the base: a wave, a coil
or frizz. All randomness comes from the generator that is passed in.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.geometry.strands import lengths

FINE = 640
"""Points of a curve before it is resampled: 16 per turn for 40 turns."""
TRANSPORT_STEPS = 64
"""Steps of the parallel transport that gives the base its twist-free frame."""


@dataclass(frozen=True)
class CurveConfig:
    """Distribution of the synthetic curves."""

    shortest: float = 0.01
    """Shortest strand, metres."""
    longest: float = 0.60
    """Longest strand, metres."""
    smooth: float = 0.45
    """Share of curves with neither wave nor coil."""
    wavy: float = 0.2
    """Share of curves with a planar or elliptic wave; the rest are coiled."""
    most_turns: float = 30.0
    """Largest number of turns of a coil or wave along a strand (100 points cannot show more)."""
    augment: bool = True
    """Whether to stretch each axis, mirror along tangent and bitangent, and rotate about the normal, as in the
    paper."""


def synthetic_curves(
    count: int,
    generator: torch.Generator,
    config: CurveConfig | None = None,
    points: int = 100,
    device: torch.device | str = "cpu",
) -> Float[Tensor, "{count} {points} 3"]:
    """Draw `count` strands in local metres, root at 0, equally spaced in arc length.

    Args:
        count: number of strands.
        generator: source of all randomness.
        config: distribution of the curves.
        points: points per strand.
        device: device of the result.
    """
    config = config or CurveConfig()
    draw = _Draw(count, generator, torch.device(device))
    length = config.shortest * (config.longest / config.shortest) ** draw.uniform(0.0, 1.0)
    winding = _draw_winding(draw, length, config)
    base = _base_curve(draw, length * winding.shortening)
    curve = base + _wound_offset(draw, base, winding)
    curve = curve + _frizz(draw, length)
    curve = curve - curve[:, :1]
    if config.augment:
        curve = augment(curve, generator)
    return _within(resample_polyline_lengths(curve, points), config)


def augment(
    curves: Float[Tensor, "strand point 3"], generator: torch.Generator, stretch: float = 0.25
) -> Float[Tensor, "strand point 3"]:
    """Stretch each axis by up to `stretch`, mirror along tangent and bitangent, rotate about the normal (paper)."""
    draw = _Draw(len(curves), generator, curves.device)
    scale = 1 + stretch * draw.uniform(-1.0, 1.0, 3)
    mirror = torch.cat([draw.uniform(0.0, 1.0, 2).round() * 2 - 1, torch.ones_like(scale[:, :1])], dim=1)
    turned = _rotate_about_normal(draw.uniform(0.0, 2 * math.pi), curves * (scale * mirror)[:, None])
    return turned.to(curves.dtype)


@dataclass(frozen=True)
class _Draw:
    """Draws random numbers per curve, all from one generator."""

    count: int
    generator: torch.Generator
    device: torch.device

    def uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Uniform numbers of shape (count, *shape)."""
        numbers = torch.rand(self.count, *shape, generator=self.generator, device=self.generator.device)
        return (low + (high - low) * numbers).to(self.device)

    def log_uniform(self, low: float, high: float, *shape: int) -> Tensor:
        """Numbers whose logarithm is uniform."""
        return torch.exp(self.uniform(math.log(low), math.log(high), *shape))

    def normal(self, *shape: int) -> Tensor:
        """Standard normal numbers of shape (count, *shape)."""
        return torch.randn(self.count, *shape, generator=self.generator, device=self.generator.device).to(self.device)

    def chance(self, probability: float) -> Tensor:
        """1 with this probability, else 0."""
        return (self.uniform(0.0, 1.0) < probability).float()

    def noise(self, knots: int, channels: int) -> Float[Tensor, "curve fine channel"]:
        """Cubic B-spline noise with `knots` random control values along the curve."""
        values = self.normal(channels, knots + 3)
        position = torch.linspace(0, knots - 1e-4, FINE, device=self.device)
        index = position.long()
        x = position - index
        weights = (
            torch.stack([(1 - x) ** 3, 3 * x**3 - 6 * x**2 + 4, -3 * x**3 + 3 * x**2 + 3 * x + 1, x**3], dim=0) / 6
        )
        basis = torch.zeros(knots + 3, FINE, device=self.device)
        for tap in range(4):
            basis[index + tap, torch.arange(FINE, device=self.device)] += weights[tap]
        return (values @ basis).transpose(1, 2)


def _base_curve(draw: _Draw, length: Float[Tensor, " curve"]) -> Float[Tensor, "curve fine 3"]:
    """Integrate a direction that leaves the scalp tilted, is pulled towards a random "down" and bends along the way."""
    t = torch.linspace(0, 1, FINE, device=draw.device)
    tilt = math.pi / 2 * draw.uniform(0.0, 1.0) ** 0.7
    start = torch.stack([tilt.sin(), torch.zeros_like(tilt), tilt.cos()], dim=-1)
    # Half of the strands fall below the tangent plane of their root, because the head curves away.
    below = draw.chance(0.5)[:, None] * torch.tensor([0.0, 0.0, -0.7], device=draw.device)
    down = torch.nn.functional.normalize(draw.normal(3) + draw.normal(1) * start + below, dim=-1)
    pull = draw.chance(0.85) * draw.log_uniform(0.2, 8.0)
    onset = draw.log_uniform(0.3, 3.0)
    weight = (1 - torch.exp(-pull[:, None] * t[None] ** onset[:, None]))[..., None]
    direction = start[:, None] * (1 - weight) + down[:, None] * weight
    bends = torch.zeros_like(direction)
    for knots, strongest in ((2, 1.0), (4, 0.6), (8, 0.35), (14, 0.2), (20, 0.12)):
        strength = draw.chance(0.6) * strongest * draw.uniform(0.0, 1.0) ** 2
        bends = bends + strength[:, None, None] * draw.noise(knots, 3)
    direction = torch.nn.functional.normalize(direction + bends, dim=-1)
    # A whorl turns the direction about the normal near the root, a hook bends the tip.
    whorl = draw.chance(0.15) * draw.normal() * 2.0
    direction = _rotate_about_normal(whorl[:, None] * (1 - torch.exp(-4 * t)), direction)
    hook = draw.chance(0.2) * draw.normal() * 1.5
    reach = draw.uniform(0.05, 0.3)
    angle = hook[:, None] * ((t - 1 + reach[:, None]).clamp(min=0) / reach[:, None]) ** 2
    direction = _rotate_about(torch.nn.functional.normalize(draw.normal(3), dim=-1), angle, direction)
    direction = torch.nn.functional.normalize(direction, dim=-1)
    step = direction * (length / FINE)[:, None, None]
    turned = _rotate_about_normal(draw.uniform(0.0, 2 * math.pi), step.cumsum(dim=1))
    return turned - turned[:, :1]


@dataclass(frozen=True)
class _Winding:
    """A wave or a coil around the base.

    Attributes:
        radius: radius of the winding, metres (0 for smooth hair).
        ratio: ratio of the second radius to the first: 0 is a planar wave, 1 a round coil.
        turns: number of turns along the strand.
        shortening: length of the base as a share of the strand's.
    """

    radius: Float[Tensor, " curve"]
    ratio: Float[Tensor, " curve"]
    turns: Float[Tensor, " curve"]
    shortening: Float[Tensor, " curve"]


def _draw_winding(draw: _Draw, length: Float[Tensor, " curve"], config: CurveConfig) -> _Winding:
    """Draw radius and pitch of each curve's winding; the pitch is the advance along the base per turn."""
    kind = draw.uniform(0.0, 1.0)
    wavy = ((kind >= config.smooth) & (kind < config.smooth + config.wavy)).float()
    coiled = (kind >= config.smooth + config.wavy).float()
    radius = wavy * draw.log_uniform(0.0004, 0.012) + coiled * draw.log_uniform(0.001, 0.012)
    pitch = draw.log_uniform(0.010, 0.08)
    ratio = torch.where(coiled > 0, draw.uniform(0.8, 1.0), draw.uniform(0.0, 1.0) * draw.chance(0.5))
    # A strand shorter than a turn or two is a bend, not a coil.
    radius = torch.minimum(radius, 0.15 * length)
    around = 2 * math.pi * radius * ((1 + ratio**2) / 2).sqrt()
    turn = (pitch**2 + around**2).sqrt()
    turns = (length / turn).clamp(max=config.most_turns)
    pitch = ((length / turns) ** 2 - around**2).clamp(min=0).sqrt()
    return _Winding(radius, ratio, turns, pitch * turns / length)


def _wound_offset(draw: _Draw, base: Float[Tensor, "curve fine 3"], winding: _Winding) -> Float[Tensor, "curve fine 3"]:
    """Offset of the winding from the base; its radius and phase drift, and it often starts at zero at the root."""
    t = torch.linspace(0, 1, FINE, device=draw.device)
    drift = draw.uniform(0.0, 0.6)[:, None] * draw.noise(2, 1)[..., 0]
    wander = draw.chance(0.6)[:, None] * draw.uniform(0.0, 1.0)[:, None] * draw.noise(4, 1)[..., 0]
    handed = draw.chance(0.5) * 2 - 1
    warped = t[None] * (1 + 0.15 * (draw.chance(0.4) * draw.normal())[:, None] * (t[None] - 1))
    turned = (handed * 2 * math.pi * winding.turns)[:, None] * warped
    phase = turned + wander + draw.uniform(0.0, 2 * math.pi)[:, None]
    grow = draw.log_uniform(0.01, 0.4)[:, None]
    rise = draw.chance(0.75)[:, None]
    envelope = (1 - rise) + rise * (1 - torch.exp(-3 * t[None] / grow))
    envelope = envelope * (winding.radius[:, None] * torch.exp(drift))
    across, other = _transported(base, draw)
    first, second = envelope * phase.cos(), envelope * winding.ratio[:, None] * phase.sin()
    wound = across * first[..., None] + other * second[..., None]
    return wound - wound[:, :1]


def _within(curves: Float[Tensor, "curve point 3"], config: CurveConfig) -> Float[Tensor, "curve point 3"]:
    """Scale curves that winding or stretching took beyond the configured lengths."""
    length = lengths(curves)
    return curves * (length.clamp(config.shortest, config.longest) / length)[:, None, None]


def _frizz(draw: _Draw, length: Float[Tensor, " curve"]) -> Float[Tensor, "curve fine 3"]:
    """Clumped noise: small offsets with an amplitude proportional to their wavelength."""
    total = torch.zeros(draw.count, FINE, 3, device=draw.device)
    for knots, strongest in ((5, 0.012), (16, 0.004), (30, 0.0012)):
        size = draw.chance(0.4) * draw.uniform(0.0, 1.0) ** 2 * strongest * length
        total = total + size[:, None, None] * draw.noise(knots, 3)
    return total


def _transported(
    base: Float[Tensor, "curve fine 3"], draw: _Draw
) -> tuple[Float[Tensor, "curve fine 3"], Float[Tensor, "curve fine 3"]]:
    """Two unit vectors perpendicular to the base that do not twist along it (parallel transport in coarse steps)."""
    tangent = torch.nn.functional.normalize(torch.diff(base, dim=1, append=2 * base[:, -1:] - base[:, -2:-1]), dim=-1)
    coarse = tangent[:, :: FINE // TRANSPORT_STEPS]
    across = torch.nn.functional.normalize(torch.linalg.cross(coarse[:, 0], draw.normal(3), dim=-1), dim=-1)
    steps = [across]
    for step in range(1, coarse.shape[1]):
        across = across - (across * coarse[:, step]).sum(-1, keepdim=True) * coarse[:, step]
        across = torch.nn.functional.normalize(across, dim=-1)
        steps.append(across)
    dense = torch.nn.functional.interpolate(
        torch.stack(steps, dim=-1), size=FINE, mode="linear", align_corners=True
    ).transpose(1, 2)
    dense = dense - (dense * tangent).sum(-1, keepdim=True) * tangent
    dense = torch.nn.functional.normalize(dense, dim=-1)
    return dense, torch.linalg.cross(tangent, dense, dim=-1)


def _rotate_about_normal(
    angle: Float[Tensor, "*curve_fine"], vectors: Float[Tensor, "curve point 3"]
) -> Float[Tensor, "curve point 3"]:
    """Rotate about the third axis by one angle per curve or per point."""
    angle = angle if angle.ndim == 2 else angle[:, None]
    cos, sin = angle.cos(), angle.sin()
    x, y, z = vectors.unbind(dim=-1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y, z], dim=-1)


def _rotate_about(
    axis: Float[Tensor, "curve 3"], angle: Float[Tensor, "curve fine"], vectors: Float[Tensor, "curve fine 3"]
) -> Float[Tensor, "curve fine 3"]:
    """Rodrigues' rotation, with one unit axis per curve."""
    axis = axis[:, None].expand_as(vectors)
    cos, sin = angle.cos()[..., None], angle.sin()[..., None]
    along = (axis * vectors).sum(-1, keepdim=True)
    return vectors * cos + torch.linalg.cross(axis, vectors, dim=-1) * sin + axis * along * (1 - cos)
