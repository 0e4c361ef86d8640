"""Visibility with an occluding head: the visual hull of hair, and the number of views that see points."""

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
"""Bounds of the number of rays to the head along the longer side of a picture; in between, half its pixels."""


@dataclass(frozen=True)
class HeadView:
    """A view, and the distance to the head in each direction.

    Attributes:
        camera: camera of the view.
        head: distance to the head along each pixel's ray, metres, at a reduced resolution.
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
        """The inputs of kernels for a view, in order."""
        projection = torch.eye(4)
        projection[:3] = self.camera.intrinsics @ self.camera.world_to_camera[:3]
        matrix, centre = wp.mat44(*projection.reshape(-1).tolist()), wp.vec3(*self.camera.position.tolist())
        return [matrix, centre, kernels.array(self.head)]


@dataclass(frozen=True)
class Silhouette:
    """Pixels of a view that may show hair.

    Attributes:
        view: the view, with distances to the head.
        hair: pixels in which there may be hair.
    """

    view: HeadView
    hair: Bool[Tensor, "height width"]

    def kernel_inputs(self) -> list:
        """The inputs of kernels for a silhouette, in order."""
        return [*self.view.kernel_inputs(), kernels.array(self.hair.to(torch.uint8))]


def head_distance(camera: Camera, rays: Float[Tensor, "pixel 3"], head: MeshIndex | None) -> Float[Tensor, " pixel"]:
    """Distance from a camera's centre to the head along unit rays, metres; infinite if they miss it."""
    if head is None:
        return torch.full((len(rays),), math.inf, device=rays.device)
    return head.ray_distance(camera.position, rays)


def points_before_head(
    camera: Camera, rays: Float[Tensor, "ray 3"], middle: Float[Tensor, "3"], head: MeshIndex, step: float, reach: float
) -> tuple[Float[Tensor, "ray step 3"], Bool[Tensor, "ray step"]]:
    """Points along rays, and which of them lie near the head and before it.

    Args:
        camera: where the rays begin.
        rays: unit directions.
        middle: of the head.
        head: stops the rays.
        step: distance between points, metres.
        reach: distance from the middle up to which they are near, metres.
    """
    far = float((middle - camera.position).norm())
    distance = torch.arange(max(far - reach, step), far + reach, step)
    points = camera.position + distance[:, None] * rays[:, None]
    near = (points - middle).norm(dim=2) < reach
    return points, near & (distance < head_distance(camera, rays, head)[:, None])


def possible_points(
    points: Float[Tensor, "point 3"], silhouettes: Iterable[Silhouette], witnesses: int = 1
) -> Bool[Tensor, " point"]:
    """Mark points that may be hair: too few views see them in front of the head and outside their silhouettes.

    Args:
        points: world metres.
        silhouettes: the views' silhouettes, used one at a time.
        witnesses: number of views, at most 255, that have to see a point to be empty.
    """
    needed = torch.full((len(points),), witnesses, dtype=torch.uint8, device=points.device)
    for silhouette in silhouettes:
        inputs = [kernels.array(points, wp.vec3), *silhouette.kernel_inputs(), kernels.array(needed)]
        kernels.launch_split(carve_points, len(points), inputs, points.device)
    return needed > 0


def visual_hull(
    grid: VoxelGrid, silhouettes: Iterable[Silhouette], within: Bool[Tensor, "x y z"], witnesses: int = 1
) -> Bool[Tensor, "x y z"]:
    """The nodes of a grid that may be hair (see `possible_points`; Laurentini 1994, with an occluder).

    Args:
        grid: the nodes to classify.
        silhouettes: the views' silhouettes, used one at a time.
        within: nodes that are considered; all others are excluded.
        witnesses: number of views, at most 255, that have to see a node to be empty.
    """
    needed = (witnesses * within.to(torch.uint8)).contiguous()
    for silhouette in silhouettes:
        inputs = [*grid.kernel_inputs(), *silhouette.kernel_inputs(), kernels.array(needed.view(-1))]
        kernels.launch_split(carve_nodes, grid.count, inputs, needed.device)
    return needed > 0


def views_that_see(
    points: Float[Tensor, "point 3"],
    outward: Float[Tensor, "point 3"],
    views: Iterable[HeadView],
    least_cosine: float,
) -> Int32[Tensor, " point"]:
    """Count the views that see each point: inside the picture, in front of the head, and facing the camera.

    Hair is opaque: a view does not see the far side of a layer of hair, even if no head occludes it. So a point counts
    as seen only from its outward side.

    Args:
        points: world metres.
        outward: unit directions away from the head.
        views: the views, used one at a time.
        least_cosine: least cosine between the outward direction and that to the camera.
    """
    count = torch.zeros(len(points), dtype=torch.int32, device=points.device)
    for view in views:
        camera = view.camera
        inputs = [kernels.array(points, wp.vec3), kernels.array(outward, wp.vec3), least_cosine]
        inputs += [*view.kernel_inputs(), camera.width, camera.height, kernels.array(count)]
        kernels.launch_split(count_views, len(points), inputs, points.device)
    return count
