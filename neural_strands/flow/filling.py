"""Values at scattered points as a volume: averaged in the voxels that hold points, filled in between."""

from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.geometry.voxel_grid import VoxelGrid

POOLING = {2: (functional.avg_pool2d, "bilinear"), 3: (functional.avg_pool3d, "trilinear")}
"""How images and volumes are halved and doubled."""


def average(
    grid: VoxelGrid,
    points: Float[Tensor, "point 3"],
    values: Float[Tensor, "point channel"],
    weights: Float[Tensor, " point"],
) -> tuple[Float[Tensor, "x y z channel"], Float[Tensor, "x y z"]]:
    """Weighted mean and summed weight of the points in each voxel; zero where there are none."""
    index, inside = grid.index(points)
    weights = weights.clamp(min=1e-6) * inside
    total = values.new_zeros(grid.count, values.shape[1]).index_add(0, index, values * weights[:, None])
    weight = values.new_zeros(grid.count).index_add(0, index, weights)
    mean = total / weight.clamp(min=1e-30)[:, None]
    return mean.reshape(*grid.shape, values.shape[1]), weight.reshape(grid.shape)


def pull_push(values: Float[Tensor, "*size channel"], weight: Float[Tensor, "*size"]) -> Float[Tensor, "*size channel"]:
    """Fill voxels or texels of weight 0 from coarser and coarser averages of the weighted ones (Gortler et al. 1996).

    A weight of 1 or more keeps a value; with less, it keeps that share, and the rest is filled.
    """
    return _filled(values.movedim(-1, 0), weight).movedim(0, -1).contiguous()


def _filled(values: Float[Tensor, " channel *size"], weight: Float[Tensor, "*size"]) -> Float[Tensor, " channel *size"]:
    known, axes = weight.clamp(max=1.0), weight.dim()
    if min(weight.shape) <= 2:
        total = (values * known).sum(dim=tuple(range(1, axes + 1)), keepdim=True) / known.sum().clamp(min=1e-9)
        return values * known + total * (1 - known)
    pool, mode = POOLING[axes]
    padding = [end for size in reversed(weight.shape) for end in (0, size % 2)]
    weighted = pool(functional.pad(values * known, padding)[None], 2)[0] * 2**axes
    summed = pool(functional.pad(known, padding)[None, None], 2)[0, 0] * 2**axes
    coarse = _filled(weighted / summed.clamp(min=1e-9), summed)
    filled = functional.interpolate(coarse[None], scale_factor=2.0, mode=mode, align_corners=False)[0]
    filled = filled[(slice(None), *(slice(size) for size in weight.shape))]
    return values * known + filled * (1 - known)
