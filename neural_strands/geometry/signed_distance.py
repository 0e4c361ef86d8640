"""Signed distance to a head, negative inside; the generalised winding number determines the sign, also of open busts.

A point is inside if its winding number exceeds one half (Jacobson et al. 2013). This closes a bust without a bottom
along the surface on which the number is one half, far from the hair.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.kernels.mesh_queries import INSIDE
from neural_strands.geometry.mesh import Mesh, face_normals
from neural_strands.geometry.mesh_queries import MeshIndex, closest_points_reference

ON_SURFACE = 1e-7
"""Distance from the surface, metres, below which the face's normal is used as the gradient."""


@dataclass(frozen=True)
class SignedDistance:
    """Distances to a surface.

    Attributes:
        distance: metres, negative inside; differentiable if `points` requires a gradient.
        closest: the closest surface point, metres.
        normal: unit gradient of the distance, pointing outwards.
    """

    distance: Float[Tensor, " point"]
    closest: Float[Tensor, "point 3"]
    normal: Float[Tensor, "point 3"]


class SignedDistanceIndex:
    """A mesh prepared for many signed distance queries."""

    def __init__(self, mesh: Mesh) -> None:
        """Build the hierarchy on the mesh's device."""
        self._index = MeshIndex(mesh, winding_number=True)
        self._face_normals = face_normals(mesh)

    def __call__(self, points: Float[Tensor, "point 3"]) -> SignedDistance:
        """Signed distance of each point; its gradient with respect to `points` is the outward direction."""
        closest, sign = self._index.closest_signed(points.detach())
        return _signed(points, closest.position, sign, self._face_normals[closest.face])


def signed_distance(points: Float[Tensor, "point 3"], mesh: Mesh) -> SignedDistance:
    """Signed distance of `points` to `mesh`; build a `SignedDistanceIndex` for repeated queries."""
    return SignedDistanceIndex(mesh)(points)


def signed_distance_reference(points: Float[Tensor, "point 3"], mesh: Mesh) -> SignedDistance:
    """`signed_distance` in plain torch, for tests: every point against every face."""
    closest = closest_points_reference(points.detach(), mesh)
    inside = winding_number(points.detach(), mesh) > INSIDE
    sign = torch.where(inside, -1.0, 1.0).to(points)
    return _signed(points, closest.position, sign, face_normals(mesh)[closest.face])


def winding_number(points: Float[Tensor, "point 3"], mesh: Mesh, points_at_once: int = 256) -> Float[Tensor, " point"]:
    """Generalised winding number: the solid angles of all faces over 4 pi (Van Oosterom and Strackee 1983)."""
    numbers = []
    for part in points.split(points_at_once):
        a, b, c = (mesh.corners().to(points)[None] - part[:, None, None]).unbind(dim=2)
        la, lb, lc = a.norm(dim=-1), b.norm(dim=-1), c.norm(dim=-1)
        numerator = (a * torch.linalg.cross(b, c)).sum(-1)
        denominator = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
        numbers.append(2.0 * torch.atan2(numerator, denominator).sum(dim=1) / (4.0 * math.pi))
    return torch.cat(numbers) if numbers else points.new_zeros(0)


def _signed(
    points: Float[Tensor, "point 3"],
    closest: Float[Tensor, "point 3"],
    sign: Float[Tensor, " point"],
    surface_normals: Float[Tensor, "point 3"],
) -> SignedDistance:
    offset = points - closest
    with torch.no_grad():
        gap = offset.norm(dim=-1, keepdim=True)
        outward = torch.where(gap > ON_SURFACE, sign[:, None] * offset / gap.clamp(min=ON_SURFACE), surface_normals)
    # The closest point moves perpendicular to the offset, so the unit direction is the gradient.
    return SignedDistance((offset * outward.to(points)).sum(-1), closest, outward.to(points))
