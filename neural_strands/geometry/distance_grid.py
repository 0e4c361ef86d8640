"""Signed distance sampled once on a grid, then interpolated trilinearly: cheap enough for every training step."""

import functools
import math
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.kernels.mesh_queries import trilinear_kernel
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import SignedDistanceIndex

POINTS_AT_ONCE = 1_000_000


@dataclass(frozen=True)
class SignedDistanceGrid:
    """Distances at the corners of a regular grid.

    Attributes:
        values: metres, negative inside, indexed by z, y, x.
        lower: the corner of index (0, 0, 0), world metres.
        spacing: metres between neighbours.
    """

    values: Float[Tensor, "depth height width"]
    lower: Float[Tensor, "3"]
    spacing: float

    @classmethod
    def build(cls, mesh: Mesh, spacing: float = 0.003, margin: float = 0.02) -> "SignedDistanceGrid":
        """Sample the mesh's box and `margin` metres around it, every `spacing` metres."""
        lower = mesh.vertices.amin(dim=0) - margin
        extent = mesh.vertices.amax(dim=0) + margin - lower
        counts = [math.ceil(length / spacing) + 1 for length in extent.tolist()]
        axes = [lower[k] + spacing * torch.arange(counts[k], device=lower.device) for k in range(3)]
        z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        points = torch.stack([x, y, z], dim=-1).reshape(-1, 3)
        index = SignedDistanceIndex(mesh)
        values = torch.cat([index(part).distance for part in points.split(POINTS_AT_ONCE)])
        return cls(values.reshape(z.shape), lower, spacing)

    def __call__(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Signed distance (metres), differentiable in `points`; outside the grid, that of the nearest point in it."""
        return _Trilinear.apply(points.reshape(-1, 3), self).reshape(points.shape[:-1])

    @functools.cached_property
    def _corner(self) -> wp.vec3:
        """`lower` in the form that kernels take, read from the device only once."""
        return wp.vec3(*self.lower.tolist())

    @property
    def largest_error(self) -> float:
        """Bound in metres of the interpolation error inside the grid: half a cell's diagonal.

        Distances change no faster than positions.
        """
        return 0.5 * math.sqrt(3) * self.spacing

    def with_outward(
        self, points: Float[Tensor, "*batch 3"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch 3"]]:
        """Signed distance (metres) and the unit direction in which it grows, at the nearest point in the grid.

        There is no gradient.
        """
        last = self.spacing * (self.lower.new_tensor(self.values.shape[::-1]) - 1)
        # Slightly inside, because slopes vanish on the border itself.
        hair = 1e-3 * self.spacing
        within = torch.minimum(torch.maximum(points, self.lower + hair), self.lower + last - hair).reshape(-1, 3)
        value, slope = _value_and_slope(self, within)
        return value.reshape(points.shape[:-1]), torch.nn.functional.normalize(slope, dim=-1).reshape(points.shape)

    def to(self, device: torch.device | str) -> "SignedDistanceGrid":
        """Move the grid to `device`."""
        return SignedDistanceGrid(self.values.to(device), self.lower.to(device), self.spacing)


class _Trilinear(torch.autograd.Function):
    """Reads value and slope in one pass; the slope is all that the backward pass needs."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, grid: SignedDistanceGrid) -> Tensor:
        value, gradient = _value_and_slope(grid, points)
        ctx.save_for_backward(gradient)
        return value.to(points)

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor) -> tuple[Tensor, None]:
        (gradient,) = ctx.saved_tensors
        return cotangents[0][:, None] * gradient.to(cotangents[0]), None


def _value_and_slope(
    grid: SignedDistanceGrid, points: Float[Tensor, "point 3"]
) -> tuple[Float[Tensor, " point"], Float[Tensor, "point 3"]]:
    """Trilinear value (metres) and its gradient."""
    flat = points.detach().float()
    value, gradient = flat.new_zeros(len(flat)), torch.zeros_like(flat)
    inputs = [
        kernels.array(grid.values.float()),
        grid._corner,
        grid.spacing,
        kernels.array(flat, wp.vec3),
        kernels.array(value),
        kernels.array(gradient, wp.vec3),
    ]
    kernels.launch_split(trilinear_kernel, len(flat), inputs, points.device)
    return value, gradient


def trilinear_reference(grid: SignedDistanceGrid, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
    """The twin of the grid's call in plain torch."""
    counts = points.new_tensor(grid.values.shape[::-1])
    cell = (points - grid.lower) / grid.spacing
    normalised = (2.0 * cell / (counts - 1) - 1.0).reshape(1, -1, 1, 1, 3)
    read = torch.nn.functional.grid_sample(
        grid.values[None, None].to(points), normalised, padding_mode="border", align_corners=True
    )
    return read.reshape(len(points))
