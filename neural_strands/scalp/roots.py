"""Roots: points of the scalp with their chart coordinates and tangent frames."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.frames import orthonormal_frames
from neural_strands.geometry.mesh import face_areas, interpolate
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.scalp.blue_noise import eliminate
from neural_strands.scalp.head import Head, scalp_vertex_frames

CANDIDATES = 4
"""Number of random candidates per blue-noise root."""


@dataclass(frozen=True)
class Roots:
    """Where strands start.

    Attributes:
        position: world metres.
        uv: chart coordinates.
        frame: columns tangent, bitangent, normal (world = frame @ local).
        distance: distance from the scalp, metres (zero for sampled roots).
    """

    position: Float[Tensor, "root 3"]
    uv: Float[Tensor, "root 2"]
    frame: Float[Tensor, "root 3 3"]
    distance: Float[Tensor, " root"]

    def __len__(self) -> int:
        return self.position.shape[0]

    @property
    def normal(self) -> Float[Tensor, "root 3"]:
        """Outward unit normals."""
        return self.frame[..., 2]

    def select(self, index: Tensor) -> "Roots":
        """Keep the roots selected by `index` (integers or booleans)."""
        return Roots(self.position[index], self.uv[index], self.frame[index], self.distance[index])

    def joined(self, others: "Roots") -> "Roots":
        """These roots, then others."""
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return Roots(*(torch.cat([mine, theirs]) for mine, theirs in pairs))

    def to(self, device: torch.device | str) -> "Roots":
        """Move every tensor to `device`."""
        moved = (getattr(self, name).to(device) for name in ("position", "uv", "frame", "distance"))
        return Roots(*moved)


def sample_roots(head: Head, count: int, generator: torch.Generator) -> Roots:
    """Sample exactly `count` blue-noise roots over the scalp, in random order.

    Raises:
        ValueError: `count` is not positive.
    """
    if count < 1:
        raise ValueError(f"count must be positive, found {count}")
    device = head.mesh.vertices.device
    face, barycentric = _random_points(head, CANDIDATES * count, generator)
    position = interpolate(head.scalp_mesh.corners(), face, barycentric)
    kept = eliminate(position.cpu(), count, head.scalp_area).to(device)
    return roots_at(head, face[kept], barycentric[kept])


def attach_roots(head: Head, positions: Float[Tensor, "root 3"]) -> Roots:
    """Roots at the given positions, with the frame and the chart coordinates of the closest point of the scalp.

    `distance` is measured to that point; rejecting distant roots (beyond 6.4 mm is usual) is left to the caller.
    """
    closest = closest_points(positions, head.scalp_mesh)
    attached = roots_at(head, closest.face, closest.barycentric)
    return Roots(positions, attached.uv, attached.frame, closest.distance)


def roots_at(head: Head, face: Int64[Tensor, " root"], barycentric: Float[Tensor, "root 3"]) -> Roots:
    """Roots at barycentric points of scalp faces (indices into `head.scalp_faces`)."""
    normals, tangents = scalp_vertex_frames(head)
    frame = orthonormal_frames(interpolate(normals, face, barycentric), interpolate(tangents, face, barycentric))
    position = interpolate(head.scalp_mesh.corners(), face, barycentric)
    uv = interpolate(head.scalp_uv, face, barycentric)
    return Roots(position, uv, frame, position.new_zeros(len(position)))


def _random_points(
    head: Head, count: int, generator: torch.Generator
) -> tuple[Int64[Tensor, " point"], Float[Tensor, "point 3"]]:
    """Sample points uniformly by area: stratified over the cumulative area, uniform within faces, in random order."""
    vertices = head.mesh.vertices
    random = torch.rand(3, count, generator=generator, device=generator.device, dtype=torch.float64).to(vertices.device)
    cumulative = face_areas(head.scalp_mesh).double().cumsum(0)
    strata = (torch.arange(count, device=vertices.device) + random[0]) / count
    face = torch.searchsorted(cumulative, strata * cumulative[-1], right=True).clamp(max=len(cumulative) - 1)
    root = random[1].sqrt()
    weights = torch.stack([1 - root, root * (1 - random[2]), root * random[2]], dim=-1)
    order = torch.randperm(count, generator=generator, device=generator.device).to(vertices.device)
    return face[order], weights[order].to(vertices)
