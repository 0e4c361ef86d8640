"""Nodes: points of the strands at which costly values are computed once for everything that is seen around them.

Several pixels see the same few segments of a strand, and values such as a colour change little between them. So they
are computed at every third point of a strand of a hundred, and visible points take a blend of the two nodes around
them. Where a strand bends, as in curls, every point is a node.
"""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from neural_strands.foundation import kernels
from neural_strands.raster.kernels import nodes as node_kernels
from neural_strands.raster.quads import quads, room_for_quads, whole_quads
from neural_strands.raster.visible import VisiblePoints, node_settings


@dataclass(frozen=True)
class VisibleNodes:
    """The nodes around visible points, strand by strand from root to tip.

    Attributes:
        strand: index of the strand.
        vertex: index of the point within the strand.
        before: for every visible point, the node before it; the node after it is the next one.
        along: position of the visible point between the two, from 0 to 1.
    """

    strand: Int64[Tensor, " node"]
    vertex: Int64[Tensor, " node"]
    before: Int64[Tensor, " visible"]
    along: Float32[Tensor, " visible"]

    def __len__(self) -> int:
        return self.strand.shape[0]

    def positions(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "node 3"]:
        """World positions."""
        return points.flatten(0, 1).index_select(0, self.strand * points.shape[1] + self.vertex)

    def directions(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "node 3"]:
        """Unit directions of growth, as `strands.directions` defines them, without those of hidden points."""
        segment = self.strand * points.shape[1] + self.vertex.clamp(max=points.shape[1] - 2)
        start, end = points.reshape(-1, 3).index_select(0, torch.cat([segment, segment + 1])).view(2, -1, 3).unbind(0)
        return torch.nn.functional.normalize(end - start, dim=1)

    def blend(self, values: Float[Tensor, "node channel"]) -> Float[Tensor, "visible channel"]:
        """Values at the visible points, from values at the nodes; with gradients to the values."""
        if values.dtype == torch.float32:
            return _Blend.apply(values, self.before, self.along)
        return self.blend_reference(values)

    def blend_reference(self, values: Float[Tensor, "node channel"]) -> Float[Tensor, "visible channel"]:
        """`blend` in plain torch, in any precision."""
        share = self.along.to(values.dtype)[:, None]
        return torch.lerp(values.index_select(0, self.before), values.index_select(0, self.before + 1), share)


def visible_nodes(visible: VisiblePoints, points: Float[Tensor, "strand point 3"]) -> VisibleNodes:
    """Find the nodes around visible points.

    On CUDA, and in compiled graphs, there may be nodes that no point needs, and as many as there was room for.

    Args:
        visible: the visible points.
        points: the strands, world metres.
    """
    strands, per_strand, _ = points.shape
    device, total = points.device, strands * per_strand
    before = kernels.zeros((len(visible),), torch.int64, device)
    along = kernels.zeros((len(visible),), torch.float32, device)
    marked = visible.marked
    marks = kernels.zeros((total if marked is None else 0,), torch.int32, device)
    seen = [kernels.array(visible.segment), kernels.array(visible.position)]
    found = [kernels.array(each) for each in (before, along, marks)]
    kernels.launch_split(node_kernels.mark_nodes, len(visible), [*seen, *node_settings(points), *found], device)
    if marked is None:
        number, place = marks.cumsum(0, dtype=torch.int32), torch.nonzero(marks).squeeze(1)
        index = number.index_select(0, before).long() - 1
    else:
        most, number = marked.room, marked.number
        # Unmarked points all go to one place beyond the end, and so do nodes without room.
        slot = torch.where(marked.marks > 0, number - 1, most).clamp(max=most).long()
        place = torch.zeros(most + 1, dtype=torch.int64, device=device)
        place = place.scatter_(0, slot, torch.arange(total, device=device))[:most]
        index = (number.index_select(0, before).long() - 1).clamp(0, most - 2)
    strand = torch.div(place, per_strand, rounding_mode="floor")
    return VisibleNodes(strand, place - strand * per_strand, index, along)


class _Blend(torch.autograd.Function):
    """`VisibleNodes.blend` by kernels."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, before: Tensor, along: Tensor) -> Tensor:
        nodes, channels = values.shape
        blended = room_for_quads(len(before), channels, values.device)
        inputs = [quads(whole_quads(values)), kernels.array(before), kernels.array(along), quads(blended)]
        kernels.launch_split(node_kernels.blend_nodes, len(before), inputs, values.device)
        ctx.save_for_backward(before, along)
        ctx.nodes = nodes
        return blended[:, :channels]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        before, along = ctx.saved_tensors
        channels, device = gradients[0].shape[1], gradients[0].device
        found = room_for_quads(ctx.nodes, channels, device)
        inputs = [quads(whole_quads(gradients[0])), kernels.array(before), kernels.array(along), quads(found)]
        kernels.launch(node_kernels.scatter_to_nodes, len(before), inputs, device)
        return found[:, :channels], None, None
