"""Detail that makes smooth strands look like hair: locks, waves and coils, frizz, flyaways."""

import math

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.geometry.frames import strand_frames
from neural_strands.geometry.point_queries import assign_locks
from neural_strands.geometry.strands import lengths, lengths_along
from neural_strands.synthesis.styles import Style

FRIZZ_MODES = 4
"""Number of sine waves in the deviation of a single strand."""
FLYAWAY_GAIN = 5.0
"""How many times further than the others a flyaway strand deviates."""


def add_detail(
    points: Float[Tensor, "strand point 3"],
    normals: Float[Tensor, "strand 3"],
    style: Style,
    generator: torch.Generator,
) -> Float[Tensor, "strand point 3"]:
    """Gather strands into locks, wave each lock, and let single strands deviate."""
    count = len(points)
    loose = _random(count, generator, points) < style.flyaways
    lock = assign_locks(points[:, 0], style.clump_spacing, generator)
    lock_small = assign_locks(points[:, 0], style.clump_spacing / 3, generator)
    tightness = style.clump_strength * (0.75 + 0.25 * _random(count, generator, points))
    tightness = torch.where(loose, torch.zeros_like(tightness), tightness)
    gathered = gather_locks(points, lock, 0.85 * tightness)
    gathered = gather_locks(gathered, lock_small, 0.7 * tightness)
    frames = strand_frames(gathered, normals)
    offset = _waves(gathered, lock, lock_small, style, generator) + _frizz(gathered, style, loose, generator)
    return gathered + (frames[..., :2] @ offset[..., None]).squeeze(-1)


def gather_locks(
    points: Float[Tensor, "strand point 3"],
    leader: Int64[Tensor, " strand"],
    tightness: Float[Tensor, " strand"],
) -> Float[Tensor, "strand point 3"]:
    """Draw strands towards their leader, not at all at the root and by `tightness` at the tip.

    The leader is taken at equal arc length where it is long enough, so that strands of unequal length stay parallel.
    """
    count = points.shape[1]
    length = lengths(points)
    along = torch.linspace(0.0, 1.0, count, device=points.device)
    position = (along * (length / length[leader])[:, None]).clamp(max=1.0) * (count - 1)
    left = position.floor().long().clamp(max=count - 2)
    weight = (position - left)[..., None]
    lead = points[leader]
    picked = [lead.gather(1, index[..., None].expand(-1, -1, 3)) for index in (left, left + 1)]
    target = picked[0] * (1 - weight) + picked[1] * weight
    pull = tightness[:, None] * smoothstep(along / 0.45)
    reach = (length[leader] / length).clamp(max=1.0)[:, None]
    pull = pull * ((reach * 1.15 - along) / 0.15).clamp(0.0, 1.0)
    return points + pull[..., None] * (target - points)


def _waves(
    points: Float[Tensor, "strand point 3"],
    lock: Int64[Tensor, " strand"],
    lock_small: Int64[Tensor, " strand"],
    style: Style,
    generator: torch.Generator,
) -> Float[Tensor, "strand point 2"]:
    """Deviation sideways and outwards: one wave per lock; its phase drifts over the head and along the strand."""
    count = len(points)
    arc = lengths_along(points)
    by_lock = torch.randn(3, count, generator=generator, device=generator.device).to(points)[:, lock]
    by_small = torch.randn(2, count, generator=generator, device=generator.device).to(points)[:, lock_small]
    own = torch.randn(2, count, generator=generator, device=generator.device).to(points)
    wave_length = style.wave_length * torch.exp(0.1 * by_lock[0] + 0.006 * by_small[0])
    amplitude = style.wave_amplitude * torch.exp(0.25 * by_lock[1] + 0.08 * own[0])
    place = points[:, 0] @ points.new_tensor([23.0, 17.0, 29.0])
    start = place + 0.8 * by_lock[2] + 0.2 * by_small[1] + 0.08 * own[1]
    drift = 0.6 * torch.sin(arc * 19.0 + by_lock[1][:, None] * 3)
    phase = 2 * math.pi * arc / wave_length[:, None] + start[:, None] + drift
    size = amplitude[:, None] * smoothstep(arc / (1.2 * style.wave_length))
    wave = torch.stack([phase.cos(), style.helix * phase.sin()], dim=-1)
    return size[..., None] * wave


def _frizz(
    points: Float[Tensor, "strand point 3"],
    style: Style,
    loose: Tensor,
    generator: torch.Generator,
) -> Float[Tensor, "strand point 2"]:
    """Each strand's own smooth deviation: a few sine waves that grow from the root."""
    count = len(points)
    arc = lengths_along(points)
    gain = style.frizz * torch.where(loose, FLYAWAY_GAIN, 1.0)
    total = points.new_zeros(*arc.shape, 2)
    for mode in range(FRIZZ_MODES):
        draws = torch.rand(count, 5, generator=generator, device=generator.device).to(points)
        frequency = 2 * math.pi * (6.0 + 14.0 * mode * draws[:, 0])
        for axis in range(2):
            phase = 2 * math.pi * draws[:, 1 + axis]
            weight = (2 * draws[:, 3 + axis] - 1) / (1 + mode)
            total[..., axis] += weight[:, None] * torch.sin(arc * frequency[:, None] + phase[:, None])
    return total * (gain[:, None] * smoothstep(arc / 0.06))[..., None]


def _random(count: int, generator: torch.Generator, like: Tensor) -> Float[Tensor, " {count}"]:
    return torch.rand(count, generator=generator, device=generator.device).to(like)
