"""Signed distance to a head on a regular grid: one look-up a point, for the millions of steps that growing takes."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import signed_distance

SPACING = 0.006
"""Distance between nodes (m)."""
LARGEST_ERROR = 0.87 * SPACING
"""Bound of the interpolation error (m): half a cell's diagonal, because distances change no faster than places do."""


@dataclass(frozen=True)
class DistanceGrid:
    """Distances (metres, negative inside) and their unit gradients at the nodes of a box.

    Attributes:
        values: distance, then the gradient's x, y, z; indexed z, y, x.
        low: the box's least corner.
        high: the box's greatest corner.
    """

    values: Float[Tensor, "1 4 depth height width"]
    low: Float[Tensor, "3"]
    high: Float[Tensor, "3"]

    @classmethod
    def build(cls, mesh: Mesh, spacing: float = SPACING, margin: float = 0.03) -> "DistanceGrid":
        """Sample the distance to `mesh` every `spacing` metres, `margin` metres beyond its bounding box."""
        low = mesh.vertices.amin(dim=0) - margin
        high = mesh.vertices.amax(dim=0) + margin
        sizes = ((high - low) / spacing).ceil().long().add(1).tolist()
        axes = [
            torch.linspace(float(low[axis]), float(high[axis]), sizes[axis], device=low.device) for axis in range(3)
        ]
        z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        nodes = torch.stack([x, y, z], dim=-1).reshape(-1, 3)
        distance = signed_distance(nodes, mesh).distance.reshape(z.shape)
        by_axis = torch.gradient(distance, spacing=(axes[2], axes[1], axes[0]))
        gradient = torch.nn.functional.normalize(torch.stack(by_axis[::-1]), dim=0)
        return cls(torch.cat([distance[None], gradient])[None], low, high)

    def sample(self, points: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch 3"]]:
        """Trilinear distance and unit outward direction; beyond the box those of its nearest side."""
        unit = (points - self.low) / (self.high - self.low) * 2 - 1
        found = torch.nn.functional.grid_sample(
            self.values, unit.reshape(1, 1, 1, -1, 3), padding_mode="border", align_corners=True
        )
        channels = found.reshape(4, -1).T.reshape(*points.shape[:-1], 4)
        return channels[..., 0], torch.nn.functional.normalize(channels[..., 1:], dim=-1)
