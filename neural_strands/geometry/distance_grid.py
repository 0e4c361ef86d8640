"""Signed distance sampled once on a grid, then interpolated trilinearly: cheap enough for every training step."""

import math
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.geometry.voxel_grid import VoxelGrid

POINTS_AT_ONCE = 1_000_000
COARSER = 4
"""Spacing of the nodes from which distances far from the surface are interpolated, in multiples of the grid's."""


@dataclass(frozen=True)
class SignedDistanceGrid:
    """Distances at the nodes of a grid.

    Attributes:
        grid: positions of the nodes.
        values: distances at the nodes, metres, negative inside.
    """

    grid: VoxelGrid
    values: Float[Tensor, "x y z"]

    @classmethod
    def build(
        cls, mesh: Mesh, spacing: float = 0.003, margin: float = 0.02, exact_within: float = math.inf
    ) -> "SignedDistanceGrid":
        """Sample the mesh's box and `margin` metres around it, every `spacing` metres.

        Distances are exact at nodes closer to the surface than `exact_within` metres; at others they may be
        interpolated on a grid `COARSER` times as wide, because a whole body has millions of nodes.
        """
        # The first nodes are on the border of the box, the last ones on it or beyond.
        low = (mesh.vertices.amin(dim=0) - margin - 0.5 * spacing).tolist()
        high = (mesh.vertices.amax(dim=0) + margin + 0.5 * spacing).tolist()
        grid = VoxelGrid.filling(low, high, spacing)
        index = MeshIndex(mesh, winding_number=True)
        nodes = grid.nodes(mesh.vertices.device).to(mesh.vertices)
        parts = nodes.reshape(-1, 3).split(POINTS_AT_ONCE)
        if math.isfinite(exact_within):
            wide = cls._coarser(grid, index)
            return cls(grid, torch.cat([wide._refined(part, exact_within, index) for part in parts]).view(grid.shape))
        distance = torch.cat([index.closest(part).distance for part in parts]).reshape(grid.shape)
        return cls(grid, distance * _signs(distance, nodes, spacing, index))

    @classmethod
    def _coarser(cls, grid: VoxelGrid, index: MeshIndex) -> "SignedDistanceGrid":
        """Exact distances on a grid with `COARSER` times the spacing that covers `grid`."""
        x, y, z = (max(math.ceil((size - 1) / COARSER), 1) + 1 for size in grid.shape)
        wide = VoxelGrid(grid.origin, COARSER * grid.spacing, (x, y, z))
        nodes = wide.nodes(index.mesh.vertices.device).to(index.mesh.vertices).reshape(-1, 3)
        closest, sign = index.closest_signed(nodes)
        return cls(wide, (closest.distance * sign).view(wide.shape))

    def _refined(self, points: Float[Tensor, "point 3"], exact_within: float, index: MeshIndex) -> Tensor:
        """Distances (metres) of points, computed exactly if they may be within `exact_within` of the surface."""
        value, is_sure = self._compared(points, 0.0)
        near = value.abs() <= exact_within + self.largest_error
        measured, signed = near & is_sure, ~is_sure
        value[measured] = index.closest(points[measured]).distance * value[measured].sign()
        closest, sign = index.closest_signed(points[signed])
        value[signed] = closest.distance * sign
        return value

    def __call__(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch"]:
        """Signed distance (metres), differentiable in `points`; outside the grid, that of the nearest point inside."""
        return _Trilinear.apply(points.reshape(-1, 3), self).reshape(points.shape[:-1])

    @property
    def largest_error(self) -> float:
        """Bound in metres of the interpolation error inside the grid: half a cell's diagonal.

        Distances change no faster than positions.
        """
        return 0.5 * math.sqrt(3) * self.grid.spacing

    def is_above(self, points: Float[Tensor, "point 3"], depth: float, mesh: Mesh) -> Bool[Tensor, " point"]:
        """Whether each point lies outside, or less than `depth` metres inside, as exactly as by `signed_distance`.

        Only points near that depth are tested against the mesh; for all others the grid is accurate enough.
        """
        over, is_sure = self._compared(points, -depth)
        above = over > 0
        above[~is_sure] = signed_distance(points[~is_sure], mesh).distance > -depth
        return above

    def _compared(
        self, points: Float[Tensor, "point 3"], level: float
    ) -> tuple[Float[Tensor, " point"], Bool[Tensor, " point"]]:
        """Distance of points minus `level` (metres), and whether its sign is certain."""
        over = self(points) - level
        # A cell whose corners differ may contain the surface that closes an open mesh, across which distances jump.
        corners = (self.values > level).float()[None, None]
        mixed = functional.max_pool3d(corners, 2, 1) + functional.max_pool3d(-corners, 2, 1) != 0
        cells = torch.tensor(mixed.shape[2:], device=points.device)
        cell = ((points - points.new_tensor(self.grid.origin)) / self.grid.spacing).floor().long()
        x, y, z = torch.minimum(cell.clamp(min=0), cells - 1).unbind(dim=1)
        return over, ~mixed[0, 0, x, y, z] & (over.abs() > self.largest_error)

    def with_outward(
        self, points: Float[Tensor, "*batch 3"]
    ) -> tuple[Float[Tensor, "*batch"], Float[Tensor, "*batch 3"]]:
        """Signed distance (metres) and the unit direction in which it grows, at the nearest point in the grid.

        There is no gradient.
        """
        spacing = self.grid.spacing
        first = points.new_tensor(self.grid.origin)
        last = first + spacing * (points.new_tensor(self.grid.shape) - 1)
        # Slightly inside, because slopes vanish on the border itself.
        little = 1e-3 * spacing
        within = torch.minimum(torch.maximum(points, first + little), last - little).reshape(-1, 3)
        value, slope = self.grid.sample_with_slope(self.values, within)
        return value.reshape(points.shape[:-1]), functional.normalize(slope, dim=-1).reshape(points.shape)

    def to(self, device: torch.device | str) -> "SignedDistanceGrid":
        """Move the grid to `device`."""
        return SignedDistanceGrid(self.grid, self.values.to(device))


def _signs(
    distance: Float[Tensor, "x y z"], nodes: Float[Tensor, "x y z 3"], spacing: float, index: MeshIndex
) -> Float[Tensor, "x y z"]:
    """-1 at the nodes inside, 1 outside.

    Winding numbers cost more than distances. Two nodes closer to each other than to the surface lie on the same side of
    it, so signs are computed at every second node, and most others copy that of a neighbour.
    """
    sign = _signs_at(nodes[::2, ::2, ::2], index)
    for axis, count in enumerate(distance.shape):
        sign = sign.repeat_interleave(2, dim=axis).narrow(axis, 0, count)
    odd = [torch.arange(count, device=sign.device) % 2 for count in distance.shape]
    apart = spacing * (odd[0][:, None, None] + odd[1][:, None] + odd[2]).sqrt()
    near = (distance <= apart) & (apart > 0)
    sign[near] = _signs_at(nodes[near], index)
    return sign


def _signs_at(places: Float[Tensor, "*batch 3"], index: MeshIndex) -> Float[Tensor, "*batch"]:
    return index.closest_signed(places.reshape(-1, 3).contiguous())[1].reshape(places.shape[:-1])


class _Trilinear(torch.autograd.Function):
    """Reads value and slope in one pass; the backward pass needs only the slope."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, distance: SignedDistanceGrid) -> Tensor:
        value, slope = distance.grid.sample_with_slope(distance.values, points)
        ctx.save_for_backward(slope)
        return value.to(points)

    @staticmethod
    def backward(ctx: Any, *cotangents: Tensor) -> tuple[Tensor, None]:
        (slope,) = ctx.saved_tensors
        return cotangents[0][:, None] * slope.to(cotangents[0]), None
