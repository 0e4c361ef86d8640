"""The sphere in which hair is searched."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.rays import nearest_to_rays
from neural_strands.geometry.voxel_grid import VoxelGrid

MOST_NODES = 12_000_000
"""Largest number of nodes of the grid over the region, whatever spacing is requested."""


@dataclass(frozen=True)
class Region:
    """The part of the world in which hair is searched.

    Attributes:
        centre: centre of the sphere, world metres.
        radius: radius of the sphere, metres.
    """

    centre: Float[Tensor, "3"]
    radius: float

    def grid(self, spacing: float, most: int = MOST_NODES) -> VoxelGrid:
        """A grid over the cube around the sphere; `spacing` (metres) grows until there are at most `most` nodes."""
        spacing = max(min(spacing, self.radius / 64), 2 * self.radius / most ** (1 / 3))
        nodes = math.ceil(2 * self.radius / spacing) + 1
        x, y, z = (self.centre - self.radius).tolist()
        return VoxelGrid((x, y, z), spacing, (nodes, nodes, nodes))

    def holds(self, grid: VoxelGrid) -> Bool[Tensor, "x y z"]:
        """Mark the nodes of its grid that lie in the sphere."""
        square = (torch.arange(grid.shape[0], device=self.centre.device) * grid.spacing - self.radius) ** 2
        return square[:, None, None] + square[:, None] + square < self.radius**2


def find_region(cameras: Sequence[Camera], hairs: Sequence[Tensor], masked: bool = True) -> Region:
    """Locate the sphere that contains the hair.

    Its centre is the point to which the viewing rays through the hair's middle come closest.

    Args:
        cameras: at least two.
        hairs: bounding box of the hair in each camera, pixels: left, top, right, bottom.
        masked: whether the boxes come from masks; if not, some may be far too large, and the median radius is used.
    """
    centre, radius = seen_radii(cameras, hairs)
    return Region(centre, 1.05 * (max(radius) if masked else sorted(radius)[len(radius) // 2]))


def seen_radii(cameras: Sequence[Camera], hairs: Sequence[Tensor]) -> tuple[Float[Tensor, "3"], list[float]]:
    """Find the point to which the viewing rays through the hair's middle come closest, and the hair's size there.

    Args:
        cameras: at least two.
        hairs: bounding box of the hair in each camera, pixels: left, top, right, bottom.

    Returns:
        The point, and the radius of the hair in each camera, metres.
    """
    middles = [camera.rays(0.5 * (box[:2] + box[2:])) for camera, box in zip(cameras, hairs, strict=True)]
    centre = nearest_to_rays(torch.stack([camera.position for camera in cameras]), torch.stack(middles))
    radius = []
    for camera, box in zip(cameras, hairs, strict=True):
        distance = float((camera.position - centre).norm())
        radius.append(camera.footprint(distance) * 0.5 * float((box[2:] - box[:2]).norm()))
    return centre, radius
