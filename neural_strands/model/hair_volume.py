"""Density of hair around a point, and the direction out of the hair.

Light that leaves hair has been scattered by many fibres: the rim of the hair glows in front of a light, tips are paler
than deep hair, and a side seen from the front differs from one seen at a grazing angle. The angles at a fibre cannot
explain this, but a coarse grid of hair density can. It counts all strands, hidden ones included, and is as easily
computed for edited hair.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation.devices.transfers import sent
from neural_strands.geometry.voxel_grid import VoxelGrid

CELL = 0.005
"""Edge of a grid cell, metres."""

MOST_CELLS = 72
"""Largest number of cells along the longest side; hair that needs more has larger cells."""

LARGER = 1.5
"""A given lattice is kept unless the hair needs cells more than this many times larger."""

WIDTHS = (0.004, 0.012)
"""Standard deviations of the Gaussians that blur the density, metres; the direction out comes from the last."""

FAINT = 0.05
"""Added to densities before their logarithm, strands per square millimetre: sparse hair starts to differ from none
here."""

SAMPLES = 16
"""Number of pieces into which a strand is divided, if it has at least as many points."""

CHANNELS = 3 + len(WIDTHS)
"""Numbers per point: the direction out of the hair, then the logarithms of the densities."""


@dataclass(frozen=True)
class HairVolume:
    """Density of hair on a grid.

    Attributes:
        grid: the voxels.
        values: decrease of density along each axis, then log densities (strands crossing a square millimetre).
    """

    grid: VoxelGrid
    values: Float[Tensor, "x y z channel"]

    def at(self, world: Float[Tensor, "point 3"]) -> Float[Tensor, "point channel"]:
        """Direction out of the hair and log densities at world positions; positions receive no gradient."""
        sampled = self.grid.sample(self.values, world, outside="border")
        return torch.cat([F.normalize(sampled[:, :3], dim=1), sampled[:, 3:]], dim=1)

    def density(self) -> Float[Tensor, "x y z"]:
        """Strands crossing a square metre: the least blurred density."""
        return 1e6 * (self.values[..., 3].exp() - FAINT).clamp(min=0.0)


@torch.no_grad()
def hair_volume(
    points: Float[Tensor, "strand point 3"], lattice: VoxelGrid | None = None, each: float = 1.0
) -> HairVolume:
    """Density of strands; points that are not finite are ignored.

    Args:
        points: strands in world metres.
        lattice: a grid whose nodes the volume reuses, extended as far as needed, so that two states of the hair can be
            compared; hair that has grown too large for its spacing gets larger cells instead.
        each: number of strands that each of them stands for.
    """
    stride = max(1, (points.shape[1] - 1) // SAMPLES)
    # Axes come first because sums over an innermost axis of three are slow.
    coarse = points[:, ::stride].permute(2, 0, 1).contiguous()
    middle = (0.5 * (coarse[:, :, 1:] + coarse[:, :, :-1])).flatten(1)
    length = (coarse[:, :, 1:] - coarse[:, :, :-1]).flatten(1).square().sum(dim=0).sqrt()
    box = _box(middle, length)
    if box is None:
        empty = VoxelGrid((0.0, 0.0, 0.0), CELL, (2, 2, 2))
        return HairVolume(empty, points.new_zeros(*empty.shape, CHANNELS))
    low, high = box
    cell = max(CELL, max(end - start for start, end in zip(low, high, strict=True)) / MOST_CELLS)
    if lattice is not None and cell <= LARGER * lattice.spacing:
        grid = lattice.extended(low, high)
    else:
        grid = VoxelGrid.filling(low, high, cell)
    cell, shape = grid.spacing, grid.shape
    start = sent(torch.tensor([first - 0.5 * cell for first in grid.origin], dtype=middle.dtype), middle.device)
    index = ((middle - start[:, None]) / cell).long().unbind(0)
    flat = (index[0] * shape[1] + index[1]) * shape[2] + index[2]
    finite = length.isfinite()
    flat, length = torch.where(finite, flat, 0), torch.where(finite, length, 0.0)
    # Metres of hair per cubic metre are strands per square metre.
    density = points.new_zeros(grid.count).index_add_(0, flat, length).view(shape) * (each / (1e6 * cell**3))
    levels, before = [], 0.0
    for width in WIDTHS:
        density = _blurred(density, (width**2 - before**2) ** 0.5 / cell)
        levels.append(density)
        before = width
    fall = [-slope for slope in torch.gradient(density)]
    logarithms = [torch.log(level + FAINT) for level in levels]
    return HairVolume(grid, torch.stack([*fall, *logarithms], dim=-1))


def _box(middle: Float[Tensor, "3 piece"], length: Float[Tensor, " piece"]) -> tuple[list[float], list[float]] | None:
    """Corners of the box around all pieces of finite length, with a margin; None if there are none.

    The host waits for the device only once.
    """
    if len(length) == 0:
        return None
    finite, margin = length.isfinite(), 3 * max(WIDTHS)
    low, high = (torch.where(finite, middle, beyond) for beyond in (torch.inf, -torch.inf))
    corners: list[list[float]] = torch.stack([low.amin(dim=1) - margin, high.amax(dim=1) + margin]).tolist()
    return (corners[0], corners[1]) if math.isfinite(corners[0][0]) else None


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
