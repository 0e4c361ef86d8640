"""A grid of points sorted by cell, for searches within a radius (Warp, CPU and CUDA).

Rows of cells along x are hashed by their y and z into a table. The cells of one row stay adjacent, so a search reads
one run of sorted points per row. Different rows that collide only cost extra candidates, because the distance of every
candidate is computed.
"""

import math
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float, Int32
from torch import Tensor

from neural_strands.foundation.kernels import array, launch
from neural_strands.geometry.kernels.point_queries import Cells, count_points, place_points

LARGEST_CELLS = 2**20
"""Largest number of cells along one axis; beyond it cells grow, and searches are slower but still exact."""


@dataclass(frozen=True)
class PointGrid:
    """Points sorted by cell; build one with `PointGrid.build` and search it as often as needed.

    Attributes:
        points: positions sorted by cell, metres.
        order: index of each sorted point in the tensor that the grid was built from.
        starts: start of each cell's points in the sorted order, followed by the number of points.
        lower: smallest coordinates of the points, metres.
        cells: number of cells along x, y and z.
        cell: edge of a cell, metres.
        mask: size of the hash table of rows minus one.
    """

    points: Float[Tensor, "point 3"]
    order: Int32[Tensor, " point"]
    starts: Int32[Tensor, " cell"]
    lower: tuple[float, float, float]
    cells: tuple[int, int, int]
    cell: float
    mask: int

    @classmethod
    def build(cls, points: Float[Tensor, "point 3"], radius: float, cell: float | None = None) -> "PointGrid":
        """Sort `points` into cells for searches within about `radius` metres (float32, any device).

        Args:
            points: positions, metres.
            radius: usual radius of a search, metres; searches with another radius are also exact.
            cell: edge of a cell in metres; by default the mean distance between points if they filled their box, but
                between an eighth of the radius and the radius (measured fastest on grooms, 2 to 10 mm).

        Raises:
            ValueError: a coordinate is not finite, or a size is not positive.
        """
        if not radius > 0 or (cell is not None and not cell > 0):
            raise ValueError(f"expected a positive radius and cell, found {radius} and {cell}")
        points = points.detach().float().contiguous()
        count, device = len(points), points.device
        if count == 0:
            zero = torch.zeros(2, dtype=torch.int32, device=device)
            return cls(points, zero[:0], zero, (0.0, 0.0, 0.0), (0, 0, 0), radius, 0)
        # One list of both corners: the host waits for the device only once.
        lower, upper = torch.stack(torch.aminmax(points, dim=0)).tolist()
        if not all(math.isfinite(value) for value in (*lower, *upper)):
            raise ValueError("expected finite points, found some that are not")
        extent = [b - a for a, b in zip(lower, upper, strict=True)]
        if cell is None:
            cell = min(max(math.cbrt(math.prod(extent) / count), radius / 8), radius)
        cell = max(cell, max(extent) / (LARGEST_CELLS - 2))
        columns, rows, slices = (int(along / cell) + 2 for along in extent)
        mask = (1 << max(2 * count - 1, 1023).bit_length()) - 1
        keys = torch.zeros(count, dtype=torch.int32, device=device)
        counts = torch.zeros(mask + columns + 2, dtype=torch.int32, device=device)
        view = array(points, wp.vec3)
        inputs = [view, wp.vec3(*lower), 1.0 / cell, mask, array(keys), array(counts)]
        launch(count_points, count, inputs, device)
        ends = counts.cumsum(0, dtype=torch.int32)
        starts = torch.cat([ends.new_zeros(1), ends])
        cursor = starts.clone()
        sorted_points, order = torch.zeros_like(points), torch.zeros_like(keys)
        placed = [view, array(keys), array(cursor), array(sorted_points, wp.vec3), array(order)]
        launch(place_points, count, placed, device)
        return cls(sorted_points, order, starts, (lower[0], lower[1], lower[2]), (columns, rows, slices), cell, mask)

    def __len__(self) -> int:
        return self.points.shape[0]

    def sorted_values(self, values: Tensor) -> Tensor:
        """Values per point, reordered from the order of the original points to the sorted order."""
        return values[self.order.long()].contiguous()

    def kernel_inputs(self) -> list:
        """The first inputs of every search kernel: points, starts and cells."""
        cells = Cells()
        cells.lower, cells.count = wp.vec3(*self.lower), wp.vec3i(*self.cells)
        cells.size, cells.mask = self.cell, self.mask
        return [array(self.points, wp.vec3), array(self.starts), cells]
