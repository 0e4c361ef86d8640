"""Strands that follow guides: every segment rotates like the guides around it at the same distance from the root.

Rotation preserves the lengths of all segments and the strand's own curls, bends and length.
"""

from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.editing.guides import choose_guides
from neural_strands.editing.haircut import arc_lengths
from neural_strands.editing.kernels.follow import turn_steps as turn_kernel
from neural_strands.foundation import kernels
from neural_strands.geometry.resample import resample_polyline_lengths
from neural_strands.geometry.strands import segments

GUIDES_EACH = 3
"""Number of guides that a strand follows."""
COMPARED = 8
"""Number of points by which strands are compared with guides."""
NEAR = 0.002
"""Distance below which strands count as equally near, metres; keeps weights finite."""
STRANDS_AT_ONCE = 8192
"""Number of strands compared with all guides together, to bound memory."""


@dataclass(frozen=True)
class Followers:
    """Strands and the guides that they follow.

    Attributes:
        chosen: which of the strands are guides.
        spacing: distance of a guide's points along it, metres.
        guides: guides of each strand, indices into `chosen`.
        weights: their weights, with a sum of 1.
        arc: distance of the middle of every segment from the root, metres.
        steps: segments at rest.
    """

    chosen: Int64[Tensor, " guide"]
    spacing: Float[Tensor, " guide"]
    guides: Int64[Tensor, "strand near"]
    weights: Float[Tensor, "strand near"]
    arc: Float[Tensor, "strand segment"]
    steps: Float[Tensor, "strand segment 3"]

    @classmethod
    def of(cls, points: Float[Tensor, "strand point 3"], count: int, nodes: int) -> "Followers":
        """Choose guides, and find those of every strand: the nearest ones in position and shape.

        Args:
            points: strands at rest, metres.
            count: number of guides.
            nodes: number of points along a guide.
        """
        chosen = choose_guides(points[:, 0], count)
        arc = arc_lengths(points)
        coarse = resample_polyline_lengths(points, COMPARED).flatten(1)
        each = min(GUIDES_EACH, len(chosen))
        found = [
            torch.cdist(part, coarse[chosen]).topk(each, dim=1, largest=False) for part in coarse.split(STRANDS_AT_ONCE)
        ]
        gap = torch.cat([near.values for near in found]) / COMPARED**0.5
        weights = 1 / (gap.square() + NEAR**2)
        # A guide follows only itself.
        weights[chosen, 1:] = 0.0
        return cls(
            chosen,
            arc[chosen, -1].clamp(min=1e-9) / (nodes - 1),
            torch.cat([near.indices for near in found]),
            weights / weights.sum(dim=1, keepdim=True),
            0.5 * (arc[:, 1:] + arc[:, :-1]),
            segments(points),
        )

    def turned(self, turns: Float[Tensor, "guide node 4"]) -> Float[Tensor, "strand segment 3"]:
        """Segments of all strands after the rotation of their guides.

        Args:
            turns: rotation of every segment of the guides relative to rest, unit quaternions x y z w.
        """
        turned = torch.zeros_like(self.steps)
        inputs = [
            kernels.array(turns, wp.quat),
            kernels.array(self.spacing),
            kernels.array(self.guides.int()),
            kernels.array(self.weights),
            kernels.array(self.arc),
            kernels.array(self.steps, wp.vec3),
            kernels.array(turned, wp.vec3),
        ]
        kernels.launch_split(turn_kernel, len(turned), inputs, turned.device)
        return turned

    def turned_reference(self, turns: Float[Tensor, "guide node 4"]) -> Float[Tensor, "strand segment 3"]:
        """`turned` in plain torch, for tests."""
        last = turns.shape[1] - 1
        near = self.guides[:, :, None]
        place = (self.arc[:, None] / self.spacing[self.guides][..., None] - 0.5).clamp(0, last)
        low = place.long().clamp(max=max(last - 1, 0))
        ends = turns[near, low], turns[near, (low + 1).clamp(max=last)]
        mixed = torch.lerp(*ends, (place - low)[..., None])
        total = torch.nn.functional.normalize((self.weights[:, :, None, None] * mixed).sum(dim=1), dim=-1)
        return rotated(total, self.steps)


def rotated(turn: Float[Tensor, "*batch 4"], vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Rotate vectors by unit quaternions, x y z w."""
    axis, real = turn[..., :3], turn[..., 3:]
    twice = 2 * torch.linalg.cross(axis, vector)
    return vector + real * twice + torch.linalg.cross(axis, twice)
