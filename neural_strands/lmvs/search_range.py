"""Where along each ray hair can be: the hull of the masks, cut by the head."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.lmvs.kernels import hull as hull_kernels

NOTHING = 1e9
"""Distance (metres) of a ray that meets no head."""


@dataclass(frozen=True)
class Region:
    """The part of the world where hair is looked for.

    Attributes:
        centre: of a sphere, metres.
        radius: of the sphere, metres.
    """

    centre: Float[Tensor, "3"]
    radius: float


@dataclass(frozen=True)
class Hull:
    """A volume carved by masks, smoothed.

    Attributes:
        grid: occupancy in [0, 1] at the nodes.
        origin: position of node (0, 0, 0), metres.
        voxel: distance of nodes, metres.
    """

    grid: Float[Tensor, "x y z"]
    origin: Float[Tensor, "3"]
    voxel: float

    def nodes(self) -> Float[Tensor, "node 3"]:
        """Positions of the nodes inside, metres, in no order: a stride through them is a fair sample."""
        inside = torch.nonzero(self.grid > 0.5)
        mixed = torch.randperm(len(inside), generator=torch.Generator().manual_seed(0)).to(inside.device)
        return self.origin + inside[mixed] * self.voxel


@dataclass(frozen=True)
class Bounds:
    """What a ray may look at.

    Attributes:
        near: distance from the camera's centre to the hull, metres; negative where the ray misses it.
        far: where the search ends, metres.
        normal: outward unit normal of the hull, turned a little towards the camera.
    """

    near: Float[Tensor, " pixel"]
    far: Float[Tensor, " pixel"]
    normal: Float[Tensor, "pixel 3"]

    def select(self, keep: Tensor) -> "Bounds":
        """Keep the rays that a boolean or integer index names."""
        return Bounds(self.near[keep], self.far[keep], self.normal[keep])


def find_region(cameras: Sequence[Camera], hairs: Sequence[Tensor], masked: bool = True) -> Region:
    """Sphere about the point that the optical axes through the hair come closest to, as large as the hair is seen.

    Args:
        cameras: at least two.
        hairs: per camera, the pixels (x, y) between which hair is seen: left, top, right, bottom.
        masked: whether these come from masks; if not, some may be far too large, and the median counts.
    """
    centre, radius = seen_radii(cameras, hairs)
    return Region(centre, 1.05 * (max(radius) if masked else sorted(radius)[len(radius) // 2]))


def seen_radii(cameras: Sequence[Camera], hairs: Sequence[Tensor]) -> tuple[Float[Tensor, "3"], list[float]]:
    """Point that the optical axes through the hair come closest to, and how large each camera sees hair there, metres.

    Args: as those of `find_region`.
    """
    device = cameras[0].intrinsics.device
    system, right = torch.zeros(3, 3, device=device), torch.zeros(3, device=device)
    for camera, box in zip(cameras, hairs, strict=True):
        axis = camera.rays(0.5 * (box[:2] + box[2:]))
        project = torch.eye(3, device=device) - axis[:, None] * axis
        system += project
        right += project @ camera.position
    centre = torch.linalg.solve(system, right)
    radius = []
    for camera, box in zip(cameras, hairs, strict=True):
        distance = float((camera.position - centre).norm())
        radius.append(camera.footprint(distance) * 0.5 * float((box[2:] - box[:2]).norm()))
    return centre, radius


def head_map(camera: Camera, mesh: wp.Mesh | None) -> Float[Tensor, "height width"]:
    """Distance from the camera's centre to the head along each pixel's ray."""
    rays = camera.rays(camera.pixel_centres()).reshape(-1, 3)
    return head_distance(camera, rays, mesh).reshape(camera.height, camera.width)


def head_distance(camera: Camera, rays: Float[Tensor, "pixel 3"], mesh: wp.Mesh | None) -> Float[Tensor, " pixel"]:
    """Distance from the camera's centre to the head along unit rays; a large number where they miss it."""
    count = len(rays)
    distance = torch.full((count,), NOTHING, device=rays.device)
    if mesh is not None:
        inputs = [mesh.id, wp.vec3(*camera.position.tolist()), kernels.array(rays, wp.vec3), kernels.array(distance)]
        kernels.launch_split(hull_kernels.trace_head, count, inputs, distance.device)
    return distance


def warp_mesh(mesh: Mesh) -> wp.Mesh:
    """The head's triangles in a hierarchy for ray queries."""
    kernels.start_warp()
    faces = mesh.faces.to(torch.int32).reshape(-1)
    return wp.Mesh(points=kernels.array(mesh.vertices, wp.vec3), indices=kernels.array(faces))


@dataclass(frozen=True)
class Sight:
    """What a view says of where there is no hair.

    Attributes:
        camera: the view's.
        hair: nonzero where there may be hair.
        head: distance to the head along each pixel's ray, metres, at half the size.
    """

    camera: Camera
    hair: UInt8[Tensor, "height width"]
    head: Float[Tensor, "rows columns"]

    def inputs(self) -> list:
        """What `hull_kernels.seen_empty` takes of a view, in its order."""
        projection = torch.eye(4)
        projection[:3] = self.camera.intrinsics @ self.camera.world_to_camera[:3]
        matrix, centre = wp.mat44(*projection.reshape(-1).tolist()), wp.vec3(*self.camera.position.tolist())
        return [matrix, centre, kernels.array(self.hair), kernels.array(self.head)]


def sight_of(camera: Camera, hair: Bool[Tensor, "height width"], mesh: wp.Mesh | None) -> Sight:
    """A view's silhouette and its distances to the head."""
    half = camera.resized(max(camera.width // 2, 1), max(camera.height // 2, 1))
    return Sight(camera, hair.to(torch.uint8), head_map(half, mesh))


def not_seen_empty(points: Float[Tensor, "point 3"], sights: Sequence[Sight]) -> Bool[Tensor, " point"]:
    """Which points no view sees, in front of the head, to be no hair."""
    kept = torch.ones(len(points), dtype=torch.uint8, device=points.device)
    for sight in sights:
        inputs = [kernels.array(points, wp.vec3), *sight.inputs(), kernels.array(kept)]
        kernels.launch_split(hull_kernels.carve_points, len(points), inputs, points.device)
    return kept > 0


class Carver:
    """Carves a box of voxels view by view, so that only one mask is in memory at a time."""

    def __init__(self, region: Region, voxel: float, most: int = 12_000_000) -> None:
        """Fill the box about the region; `voxel` (metres) grows until there are at most `most` voxels."""
        self.voxel = max(min(voxel, region.radius / 64), 2 * region.radius / most ** (1 / 3))
        self.nodes = math.ceil(2 * region.radius / self.voxel) + 1
        self.origin = region.centre - region.radius
        square = (torch.arange(self.nodes, device=region.centre.device) * self.voxel - region.radius) ** 2
        inside = square[:, None, None] + square[:, None] + square < region.radius**2
        self.kept = inside.to(torch.uint8).reshape(-1)

    def add(self, sight: Sight) -> None:
        """Drop what this view sees, in front of the head, to be no hair."""
        inputs = [wp.vec3(*self.origin.tolist()), self.voxel, self.nodes, *sight.inputs(), kernels.array(self.kept)]
        kernels.launch_split(hull_kernels.carve, len(self.kept), inputs, self.kept.device)

    def hull(self) -> Hull:
        """The volume that is left, smoothed by about a voxel."""
        grid = (self.kept > 0).float().reshape(1, 1, self.nodes, self.nodes, self.nodes)
        for _ in range(2):
            grid = torch.nn.functional.avg_pool3d(grid, 3, stride=1, padding=1)
        return Hull(grid[0, 0].contiguous(), self.origin, self.voxel)


def ray_bounds(
    camera: Camera,
    rays: Float[Tensor, "pixel 3"],
    head: Float[Tensor, " pixel"],
    hull: Hull,
    region: Region,
    thickness: float,
) -> Bounds:
    """Where each ray enters the hull, and where it stops: at the head, or `thickness` metres further on."""
    distance = float((camera.position - region.centre).norm())
    near = torch.full_like(head, -1.0)
    normal = -rays.clone()
    inputs = [
        kernels.array(hull.grid),
        wp.vec3(*hull.origin.tolist()),
        hull.voxel,
        wp.vec3(*camera.position.tolist()),
        kernels.array(rays, wp.vec3),
        kernels.array(head),
        max(distance - region.radius, 0.0),
        distance + region.radius,
        kernels.array(near),
        kernels.array(normal, wp.vec3),
    ]
    kernels.launch_split(hull_kernels.enter, len(rays), inputs, head.device)
    far = torch.minimum(near + thickness, head + hull.voxel)
    start = torch.where(near > 0, near - 0.5 * hull.voxel, near)
    return Bounds(start, torch.maximum(far, near + 2 * hull.voxel), normal)
