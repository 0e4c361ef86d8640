"""The surface of the hair's volume: which way is out."""

from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.geometry.voxel_grid import VoxelGrid

SMOOTHING = 3
"""Box filters of 5 voxels that blur the volume before its normal is taken; voxels themselves have only six normals."""


def surface_normals(
    grid: VoxelGrid, domain: Bool[Tensor, "x y z"], points: Float[Tensor, "point 3"]
) -> Float[Tensor, "point 3"]:
    """Unit directions out of the volume of the hair; zero deep inside it."""
    volume = domain.float()[None, None]
    for _ in range(SMOOTHING):
        volume = functional.avg_pool3d(functional.pad(volume, (2,) * 6), 5, stride=1)
    _, gradient = grid.sample_with_slope(volume[0, 0], points)
    return functional.normalize(-gradient, dim=-1)
