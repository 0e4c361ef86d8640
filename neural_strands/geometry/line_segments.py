"""Line segments: the hair as reconstructed by multi-view stereo, without roots ("partial strands" in the paper)."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int64
from torch import Tensor


@dataclass(frozen=True)
class LineSegments:
    """Chains of oriented points in world metres.

    Points of one segment are consecutive, and ordered along its direction of growth once that is known.

    Attributes:
        points: positions.
        directions: unit tangents; their sign is arbitrary until growth directions are estimated.
        confidence: in [0, 1].
        segment_id: index of each point's segment, non-decreasing from 0.

    Examples:
        >>> import torch
        >>> import neural_strands as ns
        >>> up = torch.tensor([0.0, 1.0, 0.0]).expand(5, 3)
        >>> segments = ns.LineSegments(up.cumsum(0), up, torch.ones(5), torch.tensor([0, 0, 0, 1, 1]))
        >>> segments.segment_count, len(segments.lines())
        (2, 3)
    """

    points: Float[Tensor, "point 3"]
    directions: Float[Tensor, "point 3"]
    confidence: Float[Tensor, " point"]
    segment_id: Int64[Tensor, " point"]

    def __len__(self) -> int:
        return self.points.shape[0]

    @property
    def segment_count(self) -> int:
        """Number of chains."""
        return int(self.segment_id[-1]) + 1 if len(self) else 0

    def lines(self) -> Float[Tensor, "line 2 3"]:
        """Every pair of consecutive points of a segment, as a strand of two points."""
        together = self.segment_id[1:] == self.segment_id[:-1]
        return torch.stack([self.points[:-1][together], self.points[1:][together]], dim=1)

    def select(self, keep: Tensor) -> "LineSegments":
        """Keep the points selected by a boolean or integer index; ids are renumbered without gaps."""
        kept_id = self.segment_id[keep]
        _, renumbered = torch.unique_consecutive(kept_id, return_inverse=True)
        return replace(
            self,
            points=self.points[keep],
            directions=self.directions[keep],
            confidence=self.confidence[keep],
            segment_id=renumbered,
        )

    def to(self, device: torch.device | str) -> "LineSegments":
        """Move every tensor to `device`."""
        return LineSegments(
            self.points.to(device),
            self.directions.to(device),
            self.confidence.to(device),
            self.segment_id.to(device),
        )
