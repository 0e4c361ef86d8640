"""Triangle meshes: areas, normals and barycentric interpolation."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int64
from torch import Tensor


@dataclass(frozen=True)
class Mesh:
    """Triangles in world metres.

    Attributes:
        vertices: positions.
        faces: vertex indices, counter-clockwise seen from outside.
        corner_uv: texture coordinates of each face's corners in [0, 1], v up, if there are any.
    """

    vertices: Float[Tensor, "vertex 3"]
    faces: Int64[Tensor, "face 3"]
    corner_uv: Float[Tensor, "face 3 2"] | None = None

    def to(self, device: torch.device | str) -> "Mesh":
        """Move every tensor to `device`."""
        uv = None if self.corner_uv is None else self.corner_uv.to(device)
        return replace(self, vertices=self.vertices.to(device), faces=self.faces.to(device), corner_uv=uv)

    def corners(self) -> Float[Tensor, "face 3 3"]:
        """Positions of each face's three corners."""
        return self.vertices[self.faces]


def face_normals(mesh: Mesh) -> Float[Tensor, "face 3"]:
    """Unit outward normals; zero for a degenerate face."""
    return torch.nn.functional.normalize(_area_vectors(mesh), dim=-1)


def face_areas(mesh: Mesh) -> Float[Tensor, " face"]:
    """Areas in square metres."""
    return 0.5 * _area_vectors(mesh).norm(dim=-1)


def vertex_normals(mesh: Mesh) -> Float[Tensor, "vertex 3"]:
    """Unit normals averaged over the faces around each vertex, weighted by area."""
    total = torch.zeros_like(mesh.vertices)
    area_vectors = _area_vectors(mesh)
    for corner in range(3):
        total = total.index_add(0, mesh.faces[:, corner], area_vectors)
    return torch.nn.functional.normalize(total, dim=-1)


def interpolate(
    values: Float[Tensor, "face 3 channel"],
    face: Int64[Tensor, " point"],
    barycentric: Float[Tensor, "point 3"],
) -> Float[Tensor, "point channel"]:
    """Blend the values at a face's corners with barycentric weights."""
    return (values.index_select(0, face) * barycentric[..., None]).sum(dim=1)


def barycentric_coordinates(
    points: Float[Tensor, "*batch k"], corners: Float[Tensor, "*batch 3 k"]
) -> Float[Tensor, "*batch 3"]:
    """Barycentric weights of points in (or projected onto the plane of) triangles, in any dimension k >= 2."""
    origin = corners[..., 0, :]
    edge_u, edge_v, offset = corners[..., 1, :] - origin, corners[..., 2, :] - origin, points - origin
    uu, uv, vv = (edge_u * edge_u).sum(-1), (edge_u * edge_v).sum(-1), (edge_v * edge_v).sum(-1)
    ou, ov = (offset * edge_u).sum(-1), (offset * edge_v).sum(-1)
    determinant = uu * vv - uv * uv
    v = (vv * ou - uv * ov) / determinant
    w = (uu * ov - uv * ou) / determinant
    return torch.stack([1 - v - w, v, w], dim=-1)


def _area_vectors(mesh: Mesh) -> Float[Tensor, "face 3"]:
    corners = mesh.corners()
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], dim=-1)
