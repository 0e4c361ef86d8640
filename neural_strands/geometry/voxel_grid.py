"""A regular grid of nodes in a box of the world, and interpolation between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import torch
import warp as wp
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.geometry.kernels.voxel_grid import sample_kernel, slope_kernel

ROUNDING = 1e-6
"""Share of a voxel that may be an error of rounding."""
Outside = Literal["border", "zero"]
"""Values beyond the outermost nodes: that of the nearest place on the border, or zero."""


@dataclass(frozen=True)
class VoxelGrid:
    """Nodes at equal distances along x, y and z; each is the centre of a cubic voxel.

    Volumes over a grid store a value per node, indexed by x, y, z; channels come last.

    Attributes:
        origin: position of node (0, 0, 0), metres.
        spacing: distance between neighbouring nodes, metres.
        shape: number of nodes along x, y, z, at least two each.
    """

    origin: tuple[float, float, float]
    spacing: float
    shape: tuple[int, int, int]

    @classmethod
    def filling(cls, low: Sequence[float], high: Sequence[float], spacing: float) -> "VoxelGrid":
        """The grid whose voxels fill the box from `low` to `high` (metres), or slightly more."""
        x, y, z = (max(math.ceil((end - start) / spacing), 2) for start, end in zip(low, high, strict=True))
        first = [start + 0.5 * spacing for start in low]
        return cls((first[0], first[1], first[2]), spacing, (x, y, z))

    def extended(self, low: Sequence[float], high: Sequence[float]) -> "VoxelGrid":
        """This grid with further nodes on each side, so that its voxels fill the box from `low` to `high` (metres)."""
        half, before, after = 0.5 * self.spacing, [], []
        for first, size, start, end in zip(self.origin, self.shape, low, high, strict=True):
            begin = first - half
            for missing, nodes in ((begin - start, before), (end - begin - size * self.spacing, after)):
                # A side that ends here but for rounding needs no further nodes.
                nodes.append(max(math.ceil(missing / self.spacing - ROUNDING), 0))
        x, y, z = (first - more * self.spacing for first, more in zip(self.origin, before, strict=True))
        a, b, c = (sum(sizes) for sizes in zip(before, self.shape, after, strict=True))
        return VoxelGrid((x, y, z), self.spacing, (a, b, c))

    @property
    def count(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)

    def nodes(self, device: torch.device | str = "cpu") -> Float[Tensor, "x y z 3"]:
        """World positions of the nodes."""
        axes = [
            torch.arange(size, device=device) * self.spacing + start
            for start, size in zip(self.origin, self.shape, strict=True)
        ]
        return torch.stack(torch.meshgrid(*axes, indexing="ij"), dim=-1)

    def index(self, points: Float[Tensor, "point 3"]) -> tuple[Int64[Tensor, " point"], Bool[Tensor, " point"]]:
        """Flat index of each point's voxel (clamped to the box), and whether the point lies in the box."""
        low = points.new_tensor([first - 0.5 * self.spacing for first in self.origin])
        voxel = ((points - low) / self.spacing).floor().long()
        size = torch.tensor(self.shape, device=points.device)
        inside = ((voxel >= 0) & (voxel < size)).all(dim=-1)
        voxel = torch.minimum(voxel.clamp(min=0), size - 1)
        return (voxel[:, 0] * self.shape[1] + voxel[:, 1]) * self.shape[2] + voxel[:, 2], inside

    def depth(self, points: Float[Tensor, "point 3"]) -> Float[Tensor, " point"]:
        """Distance of points inside the box from its border, metres; negative outside."""
        low = points.new_tensor(self.origin) - 0.5 * self.spacing
        high = low + self.spacing * points.new_tensor(self.shape)
        return torch.minimum(points - low, high - points).amin(dim=1)

    def sample(
        self, values: Float[Tensor, "x y z channel"], points: Float[Tensor, "point 3"], outside: Outside
    ) -> Float[Tensor, "point channel"]:
        """Trilinear interpolation between the nodes, without gradients.

        Args:
            values: values at the nodes.
            points: world metres.
            outside: the value beyond the outermost nodes.
        """
        channels, device = values.shape[-1], points.device
        sampled = kernels.zeros((len(points), channels), torch.float32, device)
        inputs = [
            *self.kernel_inputs(),
            kernels.array(values.float().reshape(-1, channels)),
            kernels.array(points.float(), wp.vec3),
            int(outside == "zero"),
            kernels.array(sampled),
        ]
        kernels.launch_split(sample_kernel, len(points), inputs, device)
        return sampled

    def sample_with_slope(
        self, values: Float[Tensor, "x y z"], points: Float[Tensor, "point 3"]
    ) -> tuple[Float[Tensor, " point"], Float[Tensor, "point 3"]]:
        """Trilinear value at each point and its gradient per metre; not differentiable.

        Points beyond the outermost nodes take the border's value, which is constant along the axes that leave the box.
        """
        flat = points.detach().float()
        value, gradient = torch.zeros_like(flat[:, 0]), torch.zeros_like(flat)
        inputs = [
            *self.kernel_inputs(),
            kernels.array(values.float()),
            kernels.array(flat, wp.vec3),
            kernels.array(value),
            kernels.array(gradient, wp.vec3),
        ]
        kernels.launch_split(slope_kernel, len(flat), inputs, points.device)
        return value, gradient

    def kernel_inputs(self) -> list[Any]:
        """The inputs of kernels for a grid: origin, spacing, shape."""
        return [self.origin, self.spacing, self.shape]


def sample_reference(
    grid: VoxelGrid, values: Float[Tensor, "x y z channel"], points: Float[Tensor, "point 3"], outside: Outside
) -> Float[Tensor, "point channel"]:
    """`VoxelGrid.sample` in plain torch, for tests; differentiable in `points`."""
    place = (points - points.new_tensor(grid.origin)) / grid.spacing
    last = place.new_tensor(grid.shape) - 1
    volume = values.to(points).permute(3, 2, 1, 0)[None]
    read = torch.nn.functional.grid_sample(
        volume, (2 * place / last - 1)[None, None, None], padding_mode="border", align_corners=True
    )[0, :, 0, 0].T
    if outside == "border":
        return read
    return torch.where(((place >= 0) & (place <= last)).all(dim=-1, keepdim=True), read, 0.0)
