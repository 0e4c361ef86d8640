"""The visible points of the strands: from a line buffer to 3D points that carry a gradient.

A visible point is a blend of the two ends of its segment with constant weights (its position on the segment is not
differentiated), so its gradient goes to those two ends and to nothing hidden.
"""

import functools
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
import warp as wp
from jaxtyping import Float, Float32, Int32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.foundation.devices.late_numbers import LateNumbers
from neural_strands.raster.kernels import fragments as fragment_kernels
from neural_strands.raster.kernels import nodes as node_kernels
from neural_strands.raster.lines import LineBuffer

STRIDE = 3
"""Every how many points of a straight strand there is a node. Counted from the root, so that what remains of a cut
strand keeps its nodes."""
DENSE = 60
"""Fewest points of strands that may do without a node at each of them."""
STRAIGHT = 0.95
"""Cosine of the angle between the first and the last segment of a piece below which all its points are nodes (18
degrees). Without this limit, pictures of curls differ from those with every point as a node by 40 instead of 46 dB."""


@dataclass(frozen=True)
class MarkedNodes:
    """Which points of the strands are nodes.

    Attributes:
        marks: 1 for every point that is one.
        number: number of nodes up to and including each point.
        room: number of nodes, or the number for which there is room.
    """

    marks: Int32[Tensor, " place"]
    number: Int32[Tensor, " place"]
    room: int = 0

    @property
    def total(self) -> Int32[Tensor, "1"]:
        """Number of nodes, on the device."""
        return self.number[-1:] if len(self.number) else self.number.new_zeros(1)


class Room(NamedTuple):
    """How many visible points and nodes there is room for, so that the host need not wait for their numbers."""

    points: int
    nodes: int


@dataclass(frozen=True)
class VisiblePoints:
    """Points on strands that pixels see, in the order of the pixels.

    Attributes:
        pixel: index row * width + column of the pixel that sees the point.
        segment: global segment index.
        position: position on the segment, in [0, 1].
        weight: number of line pixels that see the point.
        world: position in world metres; its gradient goes to both ends of the segment.
        per_strand: number of segments of a strand.
        knots: parameters of the strands' points; None: evenly spaced.
        found: number of points, and of nodes where these are marked, if there was room for fixed ones: the last of
            these points may have the weight 0, or else points may be missing.
        marked: where there are nodes around these points (`raster.nodes`); None on the CPU.
    """

    pixel: Int64[Tensor, " visible"]
    segment: Int64[Tensor, " visible"]
    position: Float32[Tensor, " visible"]
    weight: Float32[Tensor, " visible"]
    world: Float[Tensor, "visible 3"]
    per_strand: int
    knots: Float[Tensor, "strand point"] | None = None
    found: LateNumbers | None = None
    marked: "MarkedNodes | None" = None

    @functools.cached_property
    def strand(self) -> Int64[Tensor, " visible"]:
        """Index of the strand."""
        return torch.div(self.segment, self.per_strand, rounding_mode="floor")

    @functools.cached_property
    def vertex(self) -> Int64[Tensor, " visible"]:
        """Index, within the strand, of the point at which the segment starts."""
        return self.segment - self.strand * self.per_strand

    @functools.cached_property
    def t(self) -> Float32[Tensor, " visible"]:
        """Parameter on the strand as it was fitted, 0 at the root and 1 at the tip."""
        if self.knots is None:
            return (self.vertex + self.position) / self.per_strand
        return _blend_ends(self.knots.float()[..., None], self.segment + self.strand, self.position)[:, 0]

    def __len__(self) -> int:
        return self.pixel.shape[0]


def visible_points(
    buffer: LineBuffer,
    points: Float[Tensor, "strand point 3"],
    factor: int = 1,
    t: Float[Tensor, "strand point"] | None = None,
    room: Room | None = None,
) -> VisiblePoints:
    """Turn a line buffer into points on the strands from which it was drawn.

    Args:
        buffer: line pixels, `factor` per image pixel along each axis.
        points: the strands, world metres.
        factor: line pixels per image pixel; those of one image pixel that see the same part of a strand become one
            point, at their mean position.
        t: parameter of every point (`Strands.t`), interpolated at visible points; None: evenly spaced.
        room: number of points in the result, and of nodes around them; None: as many as are seen.

    Raises:
        ValueError: the buffer's sides are not multiples of the factor.
    """
    segments = points.shape[1] - 1
    if room is not None and not len(points):
        room = Room(0, 0)  # No strand that parts without weight could lie on.
    marked = None if _counts_on_host(points) else _marked_nodes(buffer, points)
    nodes = buffer.segment.new_zeros(0, dtype=torch.int32) if marked is None else marked.total
    *parts, found, for_nodes = _parts(buffer, segments, factor, room, nodes)
    marked = None if marked is None else replace(marked, room=for_nodes)
    pixel, segment, position, weight = parts
    start = segment + torch.div(segment, segments, rounding_mode="floor")
    world = _blend_ends(points, start, position)
    return VisiblePoints(pixel, segment, position, weight, world, segments, t, found, marked)


def interpolate_knots(
    values: Float[Tensor, "strand knot channel"], strand: Int64[Tensor, " place"], t: Float[Tensor, " place"]
) -> Float[Tensor, "place channel"]:
    """Interpolate values given at evenly spaced knots from root to tip, at places on strands.

    Args:
        values: values at the knots.
        strand: index of the strand on which each place lies.
        t: parameter of each place, 0 at the root and 1 at the tip.
    """
    knots, flat = values.shape[1], values.flatten(0, 1)
    if knots == 1:
        return flat.index_select(0, strand)
    at = t * (knots - 1)
    before = at.floor().clamp(max=knots - 2)
    start = strand * knots + before.long()
    ends = (flat.index_select(0, start), flat.index_select(0, start + 1))
    return torch.lerp(*ends, (at - before).to(values.dtype)[:, None])


def _blend_ends(
    values: Float[Tensor, "strand point channel"],
    start: Int64[Tensor, " visible"],
    position: Float32[Tensor, " visible"],
) -> Float[Tensor, "visible channel"]:
    """Blend each value at a flat point index with the one after it."""
    channels = values.shape[2]
    ends = values.reshape(-1, channels).index_select(0, torch.cat([start, start + 1])).view(2, -1, channels)
    return torch.lerp(ends[0], ends[1], position.to(values.dtype)[:, None])


def _counts_on_host(points: Tensor) -> bool:
    """Whether the number of nodes is known without a wait, and may differ from call to call."""
    return points.device.type == "cpu" and not torch.compiler.is_compiling()


def node_settings(points: Float[Tensor, "strand point 3"]) -> list:
    """What kernels need in order to tell nodes from other points."""
    per_strand = points.shape[1]
    stride = STRIDE if per_strand >= DENSE else 1
    return [kernels.array(points.float().reshape(-1, 3), wp.vec3), per_strand, stride, STRAIGHT]


def _marked_nodes(buffer: LineBuffer, points: Float[Tensor, "strand point 3"]) -> MarkedNodes:
    """The nodes around what line pixels see."""
    strands, per_strand, _ = points.shape
    marks = kernels.zeros((strands * per_strand,), torch.int32, points.device)
    seen = [kernels.array(buffer.segment.view(-1)), kernels.array(buffer.position.view(-1))]
    inputs = [*seen, *node_settings(points), kernels.array(marks)]
    kernels.launch_split(node_kernels.mark_seen, buffer.segment.numel(), inputs, points.device)
    return MarkedNodes(marks, marks.cumsum(0, dtype=torch.int32))


def _parts(
    buffer: LineBuffer, per_strand: int, factor: int, room: Room | None, nodes: Int32[Tensor, " number"]
) -> tuple[
    Int64[Tensor, " visible"],
    Int64[Tensor, " visible"],
    Float32[Tensor, " visible"],
    Float32[Tensor, " visible"],
    LateNumbers | None,
    int,
]:
    """Parts of strands that image pixels see: pixel, segment, position on the segment, number of line pixels.

    Then the numbers of parts and nodes, if there is room for fixed ones, and the number of nodes or the room for them.

    Args:
        buffer: the line pixels.
        per_strand: number of segments of a strand.
        factor: line pixels for each image pixel, along each axis.
        room: for how many parts and nodes there is room.
        nodes: number of nodes; empty if it is not needed.
    """
    if factor == 1 and room is None:
        pixel = torch.nonzero(buffer.segment.view(-1) >= 0).squeeze(1)
        segment, position = (plane.view(-1).index_select(0, pixel) for plane in (buffer.segment, buffer.position))
        return pixel, segment, position, torch.ones_like(position), None, sum(nodes.tolist())
    height, width = (side // factor for side in buffer.segment.shape)
    if (height * factor, width * factor) != tuple(buffer.segment.shape):
        raise ValueError(f"a line buffer of {tuple(buffer.segment.shape)} has no whole pixels of {factor} x {factor}")
    device = buffer.segment.device
    segment, sizes = kernels.array(buffer.segment), [width, factor, per_strand]
    count = torch.zeros(height * width, dtype=torch.int32, device=device)
    kernels.launch_split(fragment_kernels.count_parts, len(count), [segment, *sizes, kernels.array(count)], device)
    end = count.cumsum(0, dtype=torch.int32)
    # One answer for both numbers.
    last = torch.cat([end[-1:], nodes])
    size, *for_nodes = last.tolist() if room is None else room
    pixels, segments = (torch.zeros(size, dtype=torch.int64, device=device) for _ in range(2))
    positions, weights = (torch.zeros(size, dtype=torch.float32, device=device) for _ in range(2))
    outputs = [kernels.array(plane) for plane in (count, end - count, pixels, segments, positions, weights)]
    inputs = [segment, kernels.array(buffer.position), *sizes, size, *outputs]
    kernels.launch_split(fragment_kernels.gather_parts, len(count), inputs, device)
    found = None if room is None else LateNumbers(last)
    return pixels, segments, positions, weights, found, sum(for_nodes)
