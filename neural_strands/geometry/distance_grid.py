"""Signed distance sampled once on a grid, then interpolated trilinearly: cheap enough for every training step."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.voxel_grid import VoxelGrid

POINTS_AT_ONCE = 1_000_000


@dataclass(frozen=True)
class SignedDistanceGrid:
    """Distances at the nodes of a grid.

    Attributes:
        grid: where the nodes lie.
        values: metres, negative inside.
    """

    grid: VoxelGrid
    values: Float[Tensor, "x y z"]

    @classmethod
    def build(cls, mesh: Mesh, spacing: float = 0.003, margin: float = 0.02) -> "SignedDistanceGrid":
        """Sample the mesh's box and `margin` metres around it, every `spacing` metres."""
        # The first nodes lie on the border of the box, the last ones on it or beyond.
        low = (mesh.vertices.amin(dim=0) - margin - 0.5 * spacing).tolist()
        high = (mesh.vertices.amax(dim=0) + margin + 0.5 * spacing).tolist()
        grid = VoxelGrid.filling(low, high, spacing)
        index = SignedDistanceIndex(mesh)
        nodes = grid.nodes(mesh.vertices.device).reshape(-1, 3).to(mesh.vertices)
        values = torch.cat([index(part).distance for part in nodes.split(POINTS_AT_ONCE)])
        return cls(grid, values.reshape(grid.shape))

    def __call__(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Signed distance (metres), differentiable in `points`; outside the grid, that of the nearest point in it."""
        return _Trilinear.apply(points.reshape(-1, 3), self).reshape(points.shape[:-1])

    @property
    def largest_error(self) -> float:
        """Bound in metres of the interpolation error inside the grid: half a cell's diagonal.

        Distances change no faster than positions.
        """
        return 0.5 * math.sqrt(3) * self.grid.spacing

    def with_outward(
        self, points: Float[Tensor, "*batch 3"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch 3"]]:
        """Signed distance (metres) and the unit direction in which it grows, at the nearest point in the grid.

        There is no gradient.
        """
        spacing = self.grid.spacing
        first = points.new_tensor(self.grid.origin)
        last = first + spacing * (points.new_tensor(self.grid.shape) - 1)
        # A little inside: on the border itself slopes vanish.
        little = 1e-3 * spacing
        within = torch.minimum(torch.maximum(points, first + little), last - little).reshape(-1, 3)
        value, slope = self.grid.sample_with_slope(self.values, within)
        return value.reshape(points.shape[:-1]), torch.nn.functional.normalize(slope, dim=-1).reshape(points.shape)

    def to(self, device: torch.device | str) -> "SignedDistanceGrid":
        """Move the grid to `device`."""
        return SignedDistanceGrid(self.grid, self.values.to(device))


class _Trilinear(torch.autograd.Function):
    """Reads value and slope in one pass; the slope is all that the backward pass needs."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, distance: SignedDistanceGrid) -> Tensor:
        value, slope = distance.grid.sample_with_slope(distance.values, points)
        ctx.save_for_backward(slope)
        return value.to(points)

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor) -> tuple[Tensor, None]:
        (slope,) = ctx.saved_tensors
        return cotangents[0][:, None] * slope.to(cotangents[0]), None
