"""The visible points of the strands: from a line buffer to 3D points that carry a gradient.

A visible point is a fixed blend of the two ends of its segment (the position along the segment is a constant of the
frame), so its gradient goes to those two ends and to nothing that is hidden.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from neural_strands.raster.lines import LineBuffer


@dataclass(frozen=True)
class VisiblePoints:
    """One point for each pixel that sees hair, in the order of the pixels.

    Attributes:
        pixel: index row * width + column of the pixel that sees the point.
        segment: global segment index.
        strand: which strand.
        vertex: which point of the strand the segment starts at.
        position: where on the segment, in [0, 1].
        t: where on the strand, 0 at the root and 1 at the tip.
        world: world metres; its gradient goes to both ends of the segment.
    """

    pixel: Int64[Tensor, " visible"]
    segment: Int64[Tensor, " visible"]
    strand: Int64[Tensor, " visible"]
    vertex: Int64[Tensor, " visible"]
    position: Float32[Tensor, " visible"]
    t: Float32[Tensor, " visible"]
    world: Float[Tensor, "visible 3"]

    def __len__(self) -> int:
        return self.pixel.shape[0]


def visible_points(buffer: LineBuffer, points: Float[Tensor, "strand point 3"]) -> VisiblePoints:
    """Lift every pixel that sees hair to its point on the strands that the buffer was drawn from."""
    segment = buffer.segment.view(-1)
    pixel = torch.nonzero(segment >= 0).squeeze(1)
    segment = segment.index_select(0, pixel)
    position = buffer.position.view(-1).index_select(0, pixel)
    per_strand = points.shape[1]
    strand = torch.div(segment, per_strand - 1, rounding_mode="floor")
    vertex = segment - strand * (per_strand - 1)
    t = (vertex + position) / (per_strand - 1)
    world = _blend_ends(points, segment + strand, position)
    return VisiblePoints(pixel, segment, strand, vertex, position, t, world)


def interpolate_visible(
    values: Float[Tensor, "strand point channel"], visible: VisiblePoints
) -> Float[Tensor, "visible channel"]:
    """Blend values given at the strands' points, as the visible points themselves are blended."""
    return _blend_ends(values, visible.strand * values.shape[1] + visible.vertex, visible.position)


def interpolate_knots(
    values: Float[Tensor, "strand knot channel"], visible: VisiblePoints
) -> Float[Tensor, "visible channel"]:
    """Blend values given at evenly spaced knots from root to tip at the t of the visible points."""
    knots, flat = values.shape[1], values.flatten(0, 1)
    if knots == 1:
        return flat.index_select(0, visible.strand)
    place = visible.t * (knots - 1)
    before = place.floor().clamp(max=knots - 2)
    start = visible.strand * knots + before.long()
    ends = (flat.index_select(0, start), flat.index_select(0, start + 1))
    return torch.lerp(*ends, (place - before).to(values.dtype)[:, None])


def visible_directions(points: Float[Tensor, "strand point 3"], visible: VisiblePoints) -> Float[Tensor, "visible 3"]:
    """Interpolate the unit growth directions of the segment's two ends at each visible point.

    Equals `interpolate_visible(strands.directions(points), visible)` without the directions of hidden points.
    """
    per_strand = points.shape[1]
    # The direction at the last point repeats that of the last segment.
    following = torch.clamp(visible.vertex + 1, max=per_strand - 2)
    starts = visible.strand * per_strand
    index = torch.cat(
        [starts + visible.vertex, starts + visible.vertex + 1, starts + following, starts + following + 1]
    )
    a, b, c, d = points.reshape(-1, 3).index_select(0, index).view(4, -1, 3).unbind(0)
    here = torch.nn.functional.normalize(b - a, dim=-1)
    ahead = torch.nn.functional.normalize(d - c, dim=-1)
    return torch.lerp(here, ahead, visible.position.to(points.dtype)[:, None])


def _blend_ends(
    values: Float[Tensor, "strand point channel"],
    start: Int64[Tensor, " visible"],
    position: Float32[Tensor, " visible"],
) -> Float[Tensor, "visible channel"]:
    """Blend each value at a flat point index with the one after it."""
    channels = values.shape[2]
    ends = values.reshape(-1, channels).index_select(0, torch.cat([start, start + 1])).view(2, -1, channels)
    return torch.lerp(ends[0], ends[1], position.to(values.dtype)[:, None])
