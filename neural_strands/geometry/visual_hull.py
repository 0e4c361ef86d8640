"""The visual hull of hair: what no view sees, in front of the head, to be empty (Laurentini 1994, with an occluder)."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.kernels.visual_hull import carve_nodes, carve_points
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.voxel_grid import VoxelGrid


@dataclass(frozen=True)
class Silhouette:
    """What a view says about where there is no hair.

    Attributes:
        camera: the view's.
        hair: nonzero where there may be hair.
        head: distance to the head along each pixel's ray, metres, at half the size.
    """

    camera: Camera
    hair: UInt8[Tensor, "height width"]
    head: Float[Tensor, "rows columns"]

    @classmethod
    def of(cls, camera: Camera, hair: Bool[Tensor, "height width"], head: MeshIndex | None) -> "Silhouette":
        """The silhouette of a view whose pixels may show hair where `hair` says so."""
        half = camera.resized(max(camera.width // 2, 1), max(camera.height // 2, 1))
        rays = half.rays(half.pixel_centres()).reshape(-1, 3)
        distance = head_distance(half, rays, head).reshape(half.height, half.width)
        return cls(camera, hair.to(torch.uint8), distance)

    def kernel_inputs(self) -> list:
        """What carving kernels take of a view, in their order."""
        projection = torch.eye(4)
        projection[:3] = self.camera.intrinsics @ self.camera.world_to_camera[:3]
        matrix, centre = wp.mat44(*projection.reshape(-1).tolist()), wp.vec3(*self.camera.position.tolist())
        return [matrix, centre, kernels.array(self.hair), kernels.array(self.head)]


def head_distance(camera: Camera, rays: Float[Tensor, "pixel 3"], head: MeshIndex | None) -> Float[Tensor, " pixel"]:
    """Distance from a camera's centre to the head along unit rays, metres; infinite where they miss it."""
    if head is None:
        return torch.full((len(rays),), math.inf, device=rays.device)
    return head.ray_distance(camera.position, rays)


def possible_points(points: Float[Tensor, "point 3"], silhouettes: Iterable[Silhouette]) -> Bool[Tensor, " point"]:
    """Which points may be hair: those that no view sees, in front of the head, beside its silhouette."""
    kept = torch.ones(len(points), dtype=torch.uint8, device=points.device)
    for silhouette in silhouettes:
        inputs = [kernels.array(points, wp.vec3), *silhouette.kernel_inputs(), kernels.array(kept)]
        kernels.launch_split(carve_points, len(points), inputs, points.device)
    return kept > 0


def visual_hull(
    grid: VoxelGrid, silhouettes: Iterable[Silhouette], within: Bool[Tensor, "x y z"]
) -> Bool[Tensor, "x y z"]:
    """The nodes of a grid that may be hair (see `possible_points`).

    Args:
        grid: the nodes to judge.
        silhouettes: used one at a time, so that an iterator need not hold them all.
        within: nodes outside are none from the start.
    """
    kept = within.to(torch.uint8).contiguous()
    for silhouette in silhouettes:
        inputs = [*grid.kernel_inputs(), *silhouette.kernel_inputs(), kernels.array(kept.view(-1))]
        kernels.launch_split(carve_nodes, grid.count, inputs, kept.device)
    return kept > 0
