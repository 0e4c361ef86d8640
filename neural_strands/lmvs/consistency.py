"""Multi-view consistency: the lines of a view that other views confirm."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.lmvs.patchmatch import LineMap


@dataclass(frozen=True)
class LineCloud:
    """The lines of several views, as a cloud of points with directions.

    Attributes:
        points: world metres.
        directions: unit, unsigned.
        weight: confidence, in [0, 1].
        view: index of the view that each point comes from.
    """

    points: Float[Tensor, "point 3"]
    directions: Float[Tensor, "point 3"]
    weight: Float[Tensor, " point"]
    view: Int64[Tensor, " point"]

    def select(self, keep: Tensor) -> "LineCloud":
        """Keep the points selected by a boolean or integer index."""
        return LineCloud(self.points[keep], self.directions[keep], self.weight[keep], self.view[keep])


def join_points(parts: Sequence[LineCloud]) -> LineCloud:
    """Concatenate clouds."""
    names = LineCloud.__annotations__
    return LineCloud(*(torch.cat([getattr(part, name) for part in parts]) for name in names))


def line_points(camera: Camera, lines: LineMap) -> Float[Tensor, "point 3"]:
    """World positions of a view's lines."""
    return camera.position + camera.rays(lines.pixel.float() + 0.5) * lines.depth[:, None]


def confirmations(
    points: Float[Tensor, "point 3"],
    directions: Float[Tensor, "point 3"],
    others: Sequence[tuple[Camera, LineMap]],
    distance: float,
    angle: float,
    stride: int,
) -> Float[Tensor, " point"]:
    """Number of other views that see a line within `distance` metres and `angle` radians of a point at its projection.

    A view counts less the more its line differs; one that agrees closely is worth two that agree roughly.

    Args:
        points: positions, metres.
        directions: unit.
        others: the other views and their lines.
        distance: largest distance, metres.
        angle: largest angle, radians.
        stride: spacing of the pixels that have a line; the line in the same block of pixels is compared.
    """
    votes = points.new_zeros(len(points))
    for camera, lines in others:
        if len(lines.depth) == 0:
            continue
        found = _line_at(points, camera, lines, stride)
        near = 1 - (line_points(camera, lines)[found] - points).norm(dim=-1) / distance
        turned = torch.arccos((lines.direction[found] * directions).sum(-1).abs().clamp(max=1))
        votes += torch.where(found >= 0, near.clamp(min=0).sqrt() * (1 - turned / angle).clamp(min=0), 0.0)
    return votes


def _line_at(points: Float[Tensor, "point 3"], camera: Camera, lines: LineMap, stride: int) -> Int64[Tensor, " point"]:
    """Index of the view's line at the projection of each point, -1 if there is none."""
    shape = (camera.height // stride + 1, camera.width // stride + 1)
    index = torch.full(shape, -1, dtype=torch.int64, device=points.device)
    block = torch.div(lines.pixel, stride, rounding_mode="floor")
    index[block[:, 1], block[:, 0]] = torch.arange(len(lines.depth), device=points.device)
    pixel, depth = camera.project(points)
    cell = pixel.floor()
    inside = (depth > 0) & (cell >= 0).all(-1) & (cell[:, 0] < camera.width) & (cell[:, 1] < camera.height)
    cell = torch.div(torch.where(inside[:, None], cell, 0.0), stride, rounding_mode="floor").long()
    return torch.where(inside, index[cell[:, 1], cell[:, 0]], -1)
