"""What views say about hair, with the head in their way: where they see none (the visual hull), and what they see."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Bool, Float, Int32
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.kernels.visual_hull import carve_nodes, carve_points, count_views
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.voxel_grid import VoxelGrid

LEAST_RAYS, MOST_RAYS = 256, 512
"""To the head along the longer side of a picture: half its pixels, but small pictures need all, large ones fewer."""


@dataclass(frozen=True)
class HeadView:
    """A view and how far it sees before the head is in its way.

    Attributes:
        camera: the view's.
        head: distance to the head along each pixel's ray, metres, at a smaller size.
    """

    camera: Camera
    head: Float[Tensor, "rows columns"]

    @classmethod
    def of(cls, camera: Camera, head: MeshIndex | None) -> "HeadView":
        """Trace the rays of a camera to the head."""
        longest = max(camera.width, camera.height)
        scale = min(max(longest // 2, LEAST_RAYS), MOST_RAYS, longest) / longest
        small = camera.resized(max(round(scale * camera.width), 1), max(round(scale * camera.height), 1))
        rays = small.rays(small.pixel_centres()).reshape(-1, 3)
        return cls(camera, head_distance(small, rays, head).reshape(small.height, small.width))

    def kernel_inputs(self) -> list:
        """What kernels take of a view, in their order."""
        projection = torch.eye(4)
        projection[:3] = self.camera.intrinsics @ self.camera.world_to_camera[:3]
        matrix, centre = wp.mat44(*projection.reshape(-1).tolist()), wp.vec3(*self.camera.position.tolist())
        return [matrix, centre, kernels.array(self.head)]


@dataclass(frozen=True)
class Silhouette:
    """Where a view shows no hair.

    Attributes:
        view: its camera and the head before it.
        hair: where there may be hair.
    """

    view: HeadView
    hair: Bool[Tensor, "height width"]

    def kernel_inputs(self) -> list:
        """What kernels take of a silhouette, in their order."""
        return [*self.view.kernel_inputs(), kernels.array(self.hair.to(torch.uint8))]


def head_distance(camera: Camera, rays: Float[Tensor, "pixel 3"], head: MeshIndex | None) -> Float[Tensor, " pixel"]:
    """Distance from a camera's centre to the head along unit rays, metres; infinite where they miss it."""
    if head is None:
        return torch.full((len(rays),), math.inf, device=rays.device)
    return head.ray_distance(camera.position, rays)


def possible_points(points: Float[Tensor, "point 3"], silhouettes: Iterable[Silhouette]) -> Bool[Tensor, " point"]:
    """Which points may be hair: those that no view sees, before the head, beside its silhouette."""
    kept = torch.ones(len(points), dtype=torch.uint8, device=points.device)
    for silhouette in silhouettes:
        inputs = [kernels.array(points, wp.vec3), *silhouette.kernel_inputs(), kernels.array(kept)]
        kernels.launch_split(carve_points, len(points), inputs, points.device)
    return kept > 0


def visual_hull(
    grid: VoxelGrid, silhouettes: Iterable[Silhouette], within: Bool[Tensor, "x y z"]
) -> Bool[Tensor, "x y z"]:
    """The nodes of a grid that may be hair (see `possible_points`; Laurentini 1994, with an occluder).

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


def views_that_see(
    points: Float[Tensor, "point 3"],
    outward: Float[Tensor, "point 3"],
    views: Iterable[HeadView],
    least_cosine: float,
) -> Int32[Tensor, " point"]:
    """How many views see each point: it lies in the picture, before the head, and faces the camera.

    Hair is opaque: a view does not see the far side of a layer of hair, even where no head is in its way. So a point
    counts as seen only from the outward side.

    Args:
        points: world metres.
        outward: unit directions away from the head.
        views: used one at a time.
        least_cosine: between the outward direction and that to the camera.
    """
    count = torch.zeros(len(points), dtype=torch.int32, device=points.device)
    for view in views:
        camera = view.camera
        inputs = [kernels.array(points, wp.vec3), kernels.array(outward, wp.vec3), least_cosine]
        inputs += [*view.kernel_inputs(), camera.width, camera.height, kernels.array(count)]
        kernels.launch_split(count_views, len(points), inputs, points.device)
    return count
