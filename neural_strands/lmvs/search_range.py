"""The part of each ray on which hair can lie: from the surface of the hull inwards, as far as the head."""

from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.voxel_grid import VoxelGrid
from neural_strands.lmvs.kernels.search_range import enter
from neural_strands.lmvs.region import Region


@dataclass(frozen=True)
class SmoothHull:
    """A visual hull whose surface lies where its occupancy is one half.

    Attributes:
        grid: the positions of its nodes.
        occupancy: values at the nodes, in [0, 1].
    """

    grid: VoxelGrid
    occupancy: Float[Tensor, "x y z"]

    @classmethod
    def of(cls, grid: VoxelGrid, hull: Bool[Tensor, "x y z"]) -> "SmoothHull":
        """Smooth a hull by about a voxel."""
        occupancy = hull.float()[None, None]
        for _ in range(2):
            occupancy = torch.nn.functional.avg_pool3d(occupancy, 3, stride=1, padding=1)
        return cls(grid, occupancy[0, 0].contiguous())

    def nodes(self) -> Float[Tensor, "node 3"]:
        """Positions of the nodes inside, metres, in random order, so that any prefix is an unbiased sample."""
        inside = torch.nonzero(self.occupancy > 0.5)
        mixed = torch.randperm(len(inside), generator=torch.Generator().manual_seed(0)).to(inside.device)
        origin = self.occupancy.new_tensor(self.grid.origin)
        return origin + inside[mixed] * self.grid.spacing


@dataclass(frozen=True)
class Bounds:
    """The search range of a ray.

    Attributes:
        near: distance from the camera's centre to the hull, metres; negative if the ray misses it.
        far: distance at which the search ends, metres.
        normal: outward unit normal of the hull, turned a little towards the camera.
    """

    near: Float[Tensor, " pixel"]
    far: Float[Tensor, " pixel"]
    normal: Float[Tensor, "pixel 3"]

    def select(self, keep: Tensor) -> "Bounds":
        """Keep the rays selected by a boolean or integer index."""
        return Bounds(self.near[keep], self.far[keep], self.normal[keep])


def ray_bounds(
    camera: Camera,
    rays: Float[Tensor, "pixel 3"],
    head: Float[Tensor, " pixel"],
    hull: SmoothHull,
    region: Region,
    thickness: float,
) -> Bounds:
    """Find where each ray enters the hull, and where its search ends.

    Args:
        camera: the view.
        rays: unit directions of the pixels' rays, world axes.
        head: distance to the head along each ray, metres, at which the search ends; infinite if the ray misses it.
        hull: the carved hull.
        region: the sphere in which hair is searched.
        thickness: largest length of a search range, metres.
    """
    distance = float((camera.position - region.centre).norm())
    near = torch.full_like(head, -1.0)
    normal = -rays.clone()
    origin, spacing, _ = hull.grid.kernel_inputs()
    inputs = [
        origin,
        spacing,
        kernels.array(hull.occupancy),
        wp.vec3(*camera.position.tolist()),
        kernels.array(rays, wp.vec3),
        kernels.array(head),
        max(distance - region.radius, 0.0),
        distance + region.radius,
        kernels.array(near),
        kernels.array(normal, wp.vec3),
    ]
    kernels.launch_split(enter, len(rays), inputs, head.device)
    far = torch.minimum(near + thickness, head + spacing)
    start = torch.where(near > 0, near - 0.5 * spacing, near)
    return Bounds(start, torch.maximum(far, near + 2 * spacing), normal)
