"""Room that no ball rolling about the hair can enter: masks alone leave more where few views look along the surface.

Hair is seen between the head and the outermost segments, more or less. A ball that rolls about head and segments
without entering them cannot reach the places between (a morphological closing); where it can, there is no hair. Gaps
between segments are harmless as long as they are much narrower than the ball.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Bool, Float
from scipy import ndimage
from torch import Tensor
from torch.nn import functional

from neural_strands.foundation.configs import Between
from neural_strands.geometry.voxel_grid import VoxelGrid

COARSER = 2
"""Voxels are joined by this factor along each axis while the ball rolls."""
CROWD = 5
"""Side of the cube, in voxels, in which the neighbours of a point are counted."""


@dataclass(frozen=True)
class BallConfig:
    """The ball, and what it rolls on."""

    radius: Annotated[float, Between(1e-3, 10)] = 0.1
    """Radius of the ball, metres; with smaller ones, hair between sparse segments is lost."""
    margin: Annotated[float, Between(0, 1)] = 0.004
    """Thickness of the hair that may lie outside the segments, metres."""
    least_points: Annotated[int, Between(1, 1_000_000)] = 4
    """Segment points with fewer others around them count as strays, which the ball ignores."""


def crowded(grid: VoxelGrid, points: Float[Tensor, "point 3"], least: int) -> Bool[Tensor, "x y z"]:
    """Voxels that hold points, with at least `least` of them in the cube of `CROWD` voxels around it."""
    index, inside = grid.index(points)
    count = torch.bincount(index[inside], minlength=grid.count).float().reshape(1, 1, *grid.shape)
    around = functional.avg_pool3d(functional.pad(count, (CROWD // 2,) * 6), CROWD, stride=1) * CROWD**3
    # A mean of small integers is exact to far less than a half.
    return ((count > 0) & (around > least - 0.5))[0, 0]


def behind_ball(grid: VoxelGrid, solid: Bool[Tensor, "x y z"], config: BallConfig) -> Bool[Tensor, "x y z"]:
    """Places that the ball cannot reach from outside without entering what is solid, widened by the margin.

    Args:
        grid: the voxels.
        solid: voxels that the ball cannot enter.
        config: size of the ball, and the margin.
    """
    fill = [bound for size in reversed(grid.shape) for bound in (0, -size % COARSER)]
    padded = functional.pad(solid[None, None].float(), fill)
    coarse = (functional.max_pool3d(padded, COARSER)[0, 0] > 0).cpu().numpy()
    spacing = COARSER * grid.spacing
    if not coarse.any():
        return torch.zeros_like(solid)
    beyond = math.ceil(config.radius / spacing) + 2
    to_solid = _distance(np.pad(coarse, beyond), spacing)
    to_centres = _distance(to_solid > config.radius, spacing)
    core = (slice(beyond, -beyond),) * 3
    kept = torch.from_numpy(to_centres[core] > config.radius - config.margin).to(solid.device)
    for axis, size in enumerate(grid.shape):
        kept = kept.repeat_interleave(COARSER, dim=axis).narrow(axis, 0, size)
    return kept


def _distance(marked: npt.NDArray[np.bool_], spacing: float) -> npt.NDArray[np.float64]:
    """Distance from each voxel to the nearest marked one, metres."""
    return np.asarray(ndimage.distance_transform_edt(~marked, sampling=spacing))
