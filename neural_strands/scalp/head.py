"""A head: a mesh, the faces hair grows from, and their chart."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.mesh import Mesh, face_areas, vertex_normals


@dataclass(frozen=True)
class Head:
    """A head mesh with a chart of its scalp.

    Texture coordinates lie in [0, 1]. On charts made here u runs along world +x and v from the forehead to the nape,
    as on MakeHuman's chart, so that the chart has positive orientation seen from outside.

    Attributes:
        mesh: the whole head, metres, y up, +z out of the face.
        scalp_faces: the faces of `mesh` that hair may grow from.
        scalp_uv: chart coordinates of their corners.
    """

    mesh: Mesh
    scalp_faces: Int64[Tensor, " scalp"]
    scalp_uv: Float[Tensor, "scalp 3 2"]

    @property
    def scalp_mesh(self) -> Mesh:
        """Only the scalp: the vertices of the whole head, the faces of the scalp, uv from the chart."""
        return Mesh(self.mesh.vertices, self.mesh.faces[self.scalp_faces], self.scalp_uv)

    @property
    def scalp_area(self) -> float:
        """Area of the scalp in square metres."""
        return float(face_areas(self.scalp_mesh).sum())

    def to(self, device: torch.device | str) -> "Head":
        """Move every tensor to `device`."""
        return Head(self.mesh.to(device), self.scalp_faces.to(device), self.scalp_uv.to(device))

    def transformed(self, scale: float, rotation: Float[Tensor, "3 3"], translation: Float[Tensor, "3"]) -> "Head":
        """Apply x -> scale * rotation @ x + translation; the chart stays the same."""
        vertices = scale * self.mesh.vertices @ rotation.T.to(self.mesh.vertices) + translation.to(self.mesh.vertices)
        return replace(self, mesh=replace(self.mesh, vertices=vertices))


def scalp_vertex_frames(head: Head) -> tuple[Float[Tensor, "scalp 3 3"], Float[Tensor, "scalp 3 3"]]:
    """Smooth normals and tangents at the corners of the scalp's faces, to be interpolated and orthonormalised.

    Normals come from the whole mesh. Tangents (dP/du of each face, weighted by area) are averaged over the faces that
    share both the vertex and its place in the chart, so that they do not mix across seams.

    Returns:
        normals, tangents: unit, per corner.
    """
    scalp = head.scalp_mesh
    normals = vertex_normals(head.mesh)[scalp.faces]
    per_face = torch.nn.functional.normalize(face_tangents(scalp.corners(), head.scalp_uv), dim=-1)
    weighted = per_face * face_areas(scalp)[:, None]
    chart_vertex, count = chart_vertices(scalp.faces, head.scalp_uv)
    total = weighted.new_zeros(count, 3)
    for corner in range(3):
        total = total.index_add(0, chart_vertex[:, corner], weighted)
    tangents = total[chart_vertex]
    tangents = tangents - (tangents * normals).sum(-1, keepdim=True) * normals
    return normals, torch.nn.functional.normalize(tangents, dim=-1)


def face_tangents(corners: Float[Tensor, "face 3 3"], uv: Float[Tensor, "face 3 2"]) -> Float[Tensor, "face 3"]:
    """dP/du of each face: the direction in which u grows along the surface; zero where the chart is degenerate."""
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    uv_a, uv_b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    determinant = uv_a[:, 0] * uv_b[:, 1] - uv_b[:, 0] * uv_a[:, 1]
    direction = uv_b[:, 1:] * edge_a - uv_a[:, 1:] * edge_b
    return torch.where(determinant[:, None].abs() > 1e-14, direction / determinant[:, None], 0.0)


def chart_vertices(
    faces: Int64[Tensor, "face 3"], uv: Float[Tensor, "face 3 2"]
) -> tuple[Int64[Tensor, "face 3"], int]:
    """Number the distinct (vertex, uv) pairs of the corners; returns the numbers and how many there are."""
    quantised = (uv.reshape(-1, 2).double() * 1e6).round().long()
    key = torch.cat([faces.reshape(-1, 1), quantised], dim=1)
    unique, number = torch.unique(key, dim=0, return_inverse=True)
    return number.reshape(-1, 3), len(unique)
