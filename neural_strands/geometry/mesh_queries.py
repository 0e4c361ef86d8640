"""Closest points and ray hits of triangle meshes, through Warp's bounding volume hierarchy."""

import math
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.kernels.mesh_queries import closest_kernel, ray_kernel, signed_kernel
from neural_strands.geometry.mesh import Mesh, barycentric_coordinates


@dataclass(frozen=True)
class ClosestPoints:
    """The closest surface point of each query point.

    Attributes:
        face: index of the closest face.
        barycentric: weights of its corners.
        position: the closest point, metres.
        distance: unsigned distance to it, metres.
    """

    face: Int64[Tensor, " point"]
    barycentric: Float[Tensor, "point 3"]
    position: Float[Tensor, "point 3"]
    distance: Float[Tensor, " point"]


class MeshIndex:
    """A bounding volume hierarchy over a mesh, built once and queried many times (float32)."""

    def __init__(self, mesh: Mesh, winding_number: bool = False) -> None:
        """Build for `mesh`, on its device; `winding_number` also prepares signs."""
        if len(mesh.faces) == 0:
            raise ValueError("a mesh index needs at least one face")
        self.mesh = mesh
        kernels.start_warp()
        # Keep the arrays alive, because Warp's mesh refers to their memory by address.
        self._vertices = kernels.array(mesh.vertices.float(), wp.vec3)
        self._faces = kernels.array(mesh.faces.int().reshape(-1), wp.int32)
        self._box = [wp.vec3(*bound.tolist()) for bound in (mesh.vertices.amin(dim=0), mesh.vertices.amax(dim=0))]
        with kernels.on_torch_stream(mesh.vertices.device):
            self._warp = wp.Mesh(points=self._vertices, indices=self._faces, support_winding_number=winding_number)

    def closest(self, points: Float[Tensor, "point 3"]) -> ClosestPoints:
        """Closest surface point of each of `points`."""
        face, weights = self._outputs(points)
        inputs = [self._warp.id, kernels.array(points.float(), wp.vec3), *self._arrays(face, weights)]
        kernels.launch_split(closest_kernel, len(points), inputs, points.device)
        return _closest_points(points, self.mesh, face.long(), weights.to(points))

    def closest_signed(self, points: Float[Tensor, "point 3"]) -> tuple[ClosestPoints, Float[Tensor, " point"]]:
        """Closest surface points, and -1 inside or 1 outside; needs `winding_number`."""
        face, weights = self._outputs(points)
        sign = torch.ones(len(points), device=points.device)
        inputs = [
            self._warp.id,
            *self._box,
            kernels.array(points.float(), wp.vec3),
            *self._arrays(face, weights),
            kernels.array(sign, wp.float32),
        ]
        kernels.launch_split(signed_kernel, len(points), inputs, points.device)
        return _closest_points(points, self.mesh, face.long(), weights.to(points)), sign.to(points)

    def ray_distance(self, origin: Float[Tensor, "3"], rays: Float[Tensor, "ray 3"]) -> Float[Tensor, " ray"]:
        """Distance from `origin` along each unit ray to the surface, metres; infinite if it misses."""
        distance = torch.full((len(rays),), math.inf, device=rays.device)
        inputs = [self._warp.id, wp.vec3(*origin.tolist()), kernels.array(rays, wp.vec3), kernels.array(distance)]
        kernels.launch_split(ray_kernel, len(rays), inputs, rays.device)
        return distance

    @staticmethod
    def _outputs(points: Float[Tensor, "point 3"]) -> tuple[Tensor, Tensor]:
        face = torch.zeros(len(points), dtype=torch.int32, device=points.device)
        return face, torch.zeros(len(points), 3, device=points.device)

    @staticmethod
    def _arrays(face: Tensor, weights: Tensor) -> tuple[wp.array, wp.array]:
        return kernels.array(face, wp.int32), kernels.array(weights, wp.vec3)


def closest_points(points: Float[Tensor, "point 3"], mesh: Mesh) -> ClosestPoints:
    """Closest surface point of each of `points`; build a `MeshIndex` for repeated queries."""
    return MeshIndex(mesh).closest(points)


def closest_points_reference(points: Float[Tensor, "point 3"], mesh: Mesh, points_at_once: int = 256) -> ClosestPoints:
    """`closest_points` in plain torch, for tests: every point against every face."""
    corners = mesh.corners().to(points)
    faces, weights = [], []
    for part in points.split(points_at_once):
        candidate = _closest_on_triangles(part[:, None], corners[None])
        position = (candidate[..., None] * corners).sum(dim=-2)
        face = (position - part[:, None]).norm(dim=-1).argmin(dim=1)
        faces.append(face)
        weights.append(candidate[torch.arange(len(part), device=points.device), face])
    return _closest_points(points, mesh, torch.cat(faces), torch.cat(weights))


def _closest_points(
    points: Float[Tensor, "point 3"], mesh: Mesh, face: Int64[Tensor, " point"], weights: Float[Tensor, "point 3"]
) -> ClosestPoints:
    position = (mesh.vertices[mesh.faces[face]].to(points) * weights[..., None]).sum(dim=1)
    return ClosestPoints(face, weights, position, (points - position).norm(dim=-1))


def _closest_on_triangles(
    points: Float[Tensor, "point 1 3"], corners: Float[Tensor, "1 face 3 3"]
) -> Float[Tensor, "point face 3"]:
    """Barycentric weights of the point of each triangle closest to each point.

    The closest of the projection onto the plane (if it lies inside) and the three edges.
    """
    pairs = torch.broadcast_shapes(points.shape[:2], corners.shape[:2])
    inside = barycentric_coordinates(points.expand(*pairs, 3), corners.expand(*pairs, 3, 3))
    choices = [torch.where((inside >= 0).all(dim=-1, keepdim=True), inside, torch.inf)]
    for first in range(3):
        second = (first + 1) % 3
        edge = corners[..., second, :] - corners[..., first, :]
        along = ((points - corners[..., first, :]) * edge).sum(-1) / (edge * edge).sum(-1).clamp(min=1e-30)
        weight = torch.zeros_like(inside)
        weight[..., second] = along.clamp(0.0, 1.0)
        weight[..., first] = 1.0 - weight[..., second]
        choices.append(weight)
    stacked = torch.stack(choices)
    gap = ((stacked[..., None] * corners).sum(dim=-2) - points).norm(dim=-1).nan_to_num(nan=torch.inf)
    best = gap.argmin(dim=0)
    return stacked.gather(0, best[None, ..., None].expand(1, *best.shape, 3)).squeeze(0)
