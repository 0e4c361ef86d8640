"""Values at scattered points as a volume: averaged in the voxels that hold points, filled in between."""

from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from neural_strands.geometry.voxel_grid import VoxelGrid


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
