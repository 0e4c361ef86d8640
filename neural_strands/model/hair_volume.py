"""How much hair lies about a point, and which way is out of it.

Light that leaves hair was scattered by many fibres: the rim of the hair glows before light behind it, tips are paler
than what lies deep, and a side seen from the front looks unlike one seen at a grazing angle. None of this is told by a
fibre and its angles alone. A coarse grid of density tells it: of all strands, hidden ones too, of edited hair as well.
"""

from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation import kernels
from neural_strands.model.kernels import volume as volume_kernels

CELL = 0.005
"""Edge of a grid cell, metres."""

MOST_CELLS = 72
"""Cells along the longest side; hair that needs more has larger cells."""

WIDTHS = (0.004, 0.012)
"""Standard deviations of the Gaussians that density is averaged with, metres; the last tells which way is out."""

FAINT = 0.05
"""Density, strands a square millimetre, that sparse hair is told from none by."""

SAMPLES = 16
"""Pieces that a strand is taken as, at least where it has as many."""

CHANNELS = 3 + len(WIDTHS)
"""Numbers at a point: the direction out of the hair, then the logarithms of the densities."""


@dataclass(frozen=True)
class HairVolume:
    """Density of hair on a grid.

    Attributes:
        low: lowest corner, metres.
        cell: edge of a cell, metres.
        values: how fast density falls along each axis, log densities (strands that cross a square millimetre).
    """

    low: tuple[float, float, float]
    cell: float
    values: Float[Tensor, "x y z channel"]

    def at(self, world: Float[Tensor, "point 3"]) -> Float[Tensor, "point channel"]:
        """Direction out of the hair and log densities at world positions; no gradient to the positions.

        Blends the cells about a position; beyond the border, that of the border.
        """
        device = world.device
        sampled = kernels.zeros((len(world), CHANNELS), torch.float32, device)
        *shape, channels = self.values.shape
        inputs = [
            kernels.array(self.values.view(-1, channels)),
            wp.vec3i(*shape),
            wp.vec3(*self.low),
            self.cell,
            kernels.array(world.float(), wp.vec3),
            kernels.array(sampled),
        ]
        kernels.launch_split(volume_kernels.sample_cells, len(world), inputs, device)
        return torch.cat([F.normalize(sampled[:, :3], dim=1), sampled[:, 3:]], dim=1)


@torch.no_grad()
def hair_volume(points: Float[Tensor, "strand point 3"]) -> HairVolume:
    """Density of strands, metres; what is not finite does not count."""
    stride = max(1, (points.shape[1] - 1) // SAMPLES)
    # Axes first: sums over three neighbouring numbers are slow.
    coarse = points[:, ::stride].permute(2, 0, 1).contiguous()
    middle = (0.5 * (coarse[:, :, 1:] + coarse[:, :, :-1])).flatten(1)
    length = (coarse[:, :, 1:] - coarse[:, :, :-1]).flatten(1).square().sum(dim=0).sqrt()
    kept = length.isfinite().nonzero().squeeze(1)
    middle, length = middle.index_select(1, kept), length.index_select(0, kept)
    if len(length) == 0:
        return HairVolume((0.0, 0.0, 0.0), CELL, points.new_zeros(2, 2, 2, CHANNELS))
    margin = 3 * max(WIDTHS)
    low = middle.amin(dim=1) - margin
    extents = (middle.amax(dim=1) + margin - low).tolist()
    cell = max(CELL, max(extents) / MOST_CELLS)
    shape = [max(2, int(extent / cell) + 1) for extent in extents]
    index = ((middle - low[:, None]) / cell).long().unbind(0)
    flat = (index[0] * shape[1] + index[1]) * shape[2] + index[2]
    # Metres of hair in a cubic metre are strands across a square metre.
    density = points.new_zeros(shape[0] * shape[1] * shape[2]).index_add_(0, flat, length).view(shape) / (1e6 * cell**3)
    levels, before = [], 0.0
    for width in WIDTHS:
        density = _blurred(density, (width**2 - before**2) ** 0.5 / cell)
        levels.append(density)
        before = width
    fall = [-slope for slope in torch.gradient(density)]
    logarithms = [torch.log(level + FAINT) for level in levels]
    x, y, z = low.tolist()
    return HairVolume((x, y, z), cell, torch.stack([*fall, *logarithms], dim=-1))


def _blurred(volume: Float[Tensor, "x y z"], sigma: float) -> Float[Tensor, "x y z"]:
    """Blur with a Gaussian of standard deviation `sigma` cells; nothing lies beyond the border."""
    radius = max(1, round(3 * sigma))
    steps = torch.arange(-radius, radius + 1, dtype=torch.float64)
    weights = torch.exp(-0.5 * (steps / sigma) ** 2)
    for axis in range(3):
        size = volume.shape[axis]
        pad = [0, 0] * (2 - axis) + [radius, radius]
        padded, total = F.pad(volume, pad), torch.zeros_like(volume)
        for shift, weight in enumerate((weights / weights.sum()).tolist()):
            total.add_(padded.narrow(axis, shift, size), alpha=weight)
        volume = total
    return volume
