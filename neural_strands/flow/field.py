"""Growth directions everywhere in the hair: those of the segments, diffused inwards (Laplace's equation).

The segments cover the visible shell only. Between them and the scalp the direction is the smoothest one that agrees
with both: the mean of its neighbours, with the segments' directions fixed and the scalp pulling towards its normal.
"""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.flow.faces import face_neighbours
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.voxel_grid import VoxelGrid

MOST_VOXELS = 50_000_000
"""More than this memory should not hold."""


@dataclass(frozen=True)
class FlowConfig:
    """The volume and its diffusion."""

    spacing: Annotated[float, Between(1e-5, 1)] = 0.002
    """Edge of a voxel, metres."""
    margin: Annotated[float, Between(0, 1)] = 0.02
    """Margin of the box around segments and roots, metres."""
    iterations: Annotated[int, Between(0, 100_000)] = 25
    """Jacobi sweeps after the multigrid start. They smooth over about the square root of their number in voxels: with
    none, the steps of the start remain; many blur the differences between layers of hair."""
    normal_pull: Annotated[float, Between(0, 1)] = 0.5
    """Weight of the scalp's normal, against the flow above it, in the direction next to the scalp; 0 to 1."""
    scalp_layer: Annotated[float, Between(0, 1)] = 0.003
    """Thickness in metres of the layer that the scalp pulls."""
    least_confidence: Annotated[float, Between(0, 1)] = 0.3
    """Segment points less confident than this are ignored; half of all points have 0.5 or more, guesses have 0.1."""


@dataclass(frozen=True)
class FlowField:
    """A direction for every voxel.

    Attributes:
        grid: the voxels.
        directions: unit growth directions.
        domain: where there can be hair.
    """

    grid: VoxelGrid
    directions: Float[Tensor, "x y z 3"]
    domain: Bool[Tensor, "x y z"]


def grid_around(points: Float[Tensor, "point 3"], spacing: float, margin: float) -> VoxelGrid:
    """The grid that holds `points` with `margin` metres on every side.

    Raises:
        InputError: the box would have more voxels than memory should hold.
    """
    low, high = (points.amin(dim=0) - margin).tolist(), (points.amax(dim=0) + margin).tolist()
    grid = VoxelGrid.filling(low, high, spacing)
    if grid.count > MOST_VOXELS:
        extent = " x ".join(f"{end - start:.2f}" for start, end in zip(low, high, strict=True))
        raise InputError(
            f"the hair spans {extent} m, expected a head's size in metres at {1000 * spacing:g} mm a voxel; "
            "check the capture's scale, or remove stray segments."
        )
    return grid


def diffuse_directions(
    grid: VoxelGrid,
    domain: Bool[Tensor, "x y z"],
    segments: LineSegments,
    scalp_points: Float[Tensor, "root 3"],
    scalp_normals: Float[Tensor, "root 3"],
    config: FlowConfig | None = None,
) -> FlowField:
    """Solve for the growth direction in every voxel of the domain.

    Args:
        grid: the voxels.
        domain: where there can be hair.
        segments: oriented points, signed from root to tip.
        scalp_points: a dense sample of the scalp.
        scalp_normals: its outward normals.
        config: weights and sweeps.
    """
    config = config or FlowConfig()
    kept = segments.confidence >= config.least_confidence
    shell, weight = _average(grid, segments.points[kept], segments.directions[kept], segments.confidence[kept])
    fixed = weight > 0
    lifted = scalp_points + 0.5 * config.scalp_layer * scalp_normals
    normal, normal_weight = _average(grid, lifted, scalp_normals, torch.ones_like(scalp_points[:, 0]))
    pulled = (normal_weight > 0) & ~fixed
    domain = domain | fixed | pulled
    start = pull_push(shell, fixed.to(shell))
    cells = torch.nonzero(domain.reshape(-1)).squeeze(1)
    neighbours = face_neighbours(domain)
    value, known, normals = (volume.reshape(-1, 3)[cells] for volume in (start, shell, normal))
    is_fixed, is_pulled = (mask.reshape(-1)[cells, None] for mask in (fixed, pulled))
    value = functional.normalize(value, dim=-1)
    count = (neighbours < len(cells)).sum(dim=1, keepdim=True)
    for _ in range(config.iterations):
        padded = torch.cat([value, value.new_zeros(1, 3)])
        mean = padded[neighbours].sum(dim=1) / count.clamp(min=1)
        mean = torch.where(count > 0, mean, value)
        strength = mean.norm(dim=-1, keepdim=True).clamp(min=0.3)
        towards_normal = (1 - config.normal_pull) * mean + config.normal_pull * strength * normals
        value = torch.where(is_fixed, known, torch.where(is_pulled, towards_normal, mean))
    # Outside the domain the filled start remains, for streamlines that graze the border.
    field = start.reshape(-1, 3).index_copy(0, cells, functional.normalize(value, dim=-1)).reshape_as(start)
    return FlowField(grid, field, domain)


def pull_push(values: Float[Tensor, "x y z channel"], weight: Float[Tensor, "x y z"]) -> Float[Tensor, "x y z channel"]:
    """Fill voxels of weight 0 from coarser and coarser averages of the weighted ones (Gortler et al. 1996)."""
    return _filled(values.permute(3, 0, 1, 2), weight).permute(1, 2, 3, 0).contiguous()


def _filled(values: Float[Tensor, "channel x y z"], weight: Float[Tensor, "x y z"]) -> Float[Tensor, "channel x y z"]:
    known = weight.clamp(max=1.0)
    if min(weight.shape) <= 2:
        total = (values * known).sum(dim=(1, 2, 3)) / known.sum().clamp(min=1e-9)
        return values * known + total[:, None, None, None] * (1 - known)
    odd = [size % 2 for size in reversed(weight.shape)]
    padding = (0, odd[0], 0, odd[1], 0, odd[2])
    weighted = functional.avg_pool3d(functional.pad(values * known, padding)[None], 2)[0] * 8
    summed = functional.avg_pool3d(functional.pad(known, padding)[None], 2)[0] * 8
    coarse = _filled(weighted / summed.clamp(min=1e-9), summed)
    filled = functional.interpolate(coarse[None], scale_factor=2.0, mode="trilinear", align_corners=False)[0]
    filled = filled[:, : weight.shape[0], : weight.shape[1], : weight.shape[2]]
    return values * known + filled * (1 - known)


def _average(
    grid: VoxelGrid,
    points: Float[Tensor, "point 3"],
    directions: Float[Tensor, "point 3"],
    weights: Float[Tensor, " point"],
) -> tuple[Float[Tensor, "x y z 3"], Float[Tensor, "x y z"]]:
    """Unit mean direction and summed weight of the points in each voxel; zero where there are none."""
    index, inside = grid.index(points)
    weights = weights.clamp(min=1e-6) * inside
    total = points.new_zeros(grid.count, 3).index_add(0, index, directions * weights[:, None])
    weight = points.new_zeros(grid.count).index_add(0, index, weights)
    return functional.normalize(total, dim=-1).reshape(*grid.shape, 3), weight.reshape(grid.shape)
