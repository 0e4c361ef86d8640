"""Strands: dense polylines with the same number of points each, root first."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class Strands:
    """Rooted strands in world metres.

    Attributes:
        points: polylines, root first.
        root_uv: position of each root on the scalp chart, in [0, 1].
        root_normal: outward unit normal of the scalp at each root.
        width: full thickness at each point, metres.
        color: linear RGB of each strand in [0, 1].
        unseen: share of each strand's points that no photograph could see, in [0, 1].
        t: parameter of each point on the strand as it was fitted, 0 at its root and 1 at its tip; preserved by cuts and
            resampling, so that the rest looks as before. None: evenly spaced from 0 to 1.

    Examples:
        >>> import torch
        >>> import neural_strands as ns
        >>> strands = ns.Strands(torch.zeros(10, 100, 3))
        >>> len(strands), strands.points_per_strand, len(strands.select(torch.arange(3)))
        (10, 100, 3)
    """

    points: Float[Tensor, "strand point 3"]
    root_uv: Float[Tensor, "strand 2"] | None = None
    root_normal: Float[Tensor, "strand 3"] | None = None
    width: Float[Tensor, "strand point"] | None = None
    color: Float[Tensor, "strand 3"] | None = None
    unseen: Float[Tensor, " strand"] | None = None
    t: Float[Tensor, "strand point"] | None = None

    def __len__(self) -> int:
        return self.points.shape[0]

    @property
    def points_per_strand(self) -> int:
        """Number of points of every strand."""
        return self.points.shape[1]

    def parameters(self) -> Float[Tensor, "strand point"]:
        """The parameter t of every point: as stored, or evenly spaced."""
        if self.t is not None:
            return self.t
        even = torch.linspace(0, 1, self.points_per_strand, device=self.points.device)
        return even.expand(self.points.shape[:2])

    def chart_positions(self) -> Float[Tensor, "strand 2"]:
        """`root_uv`, for what cannot do without it: a model looks up appearance there.

        Raises:
            ValueError: the strands have no `root_uv`.
        """
        if self.root_uv is None:
            raise ValueError("expected strands with root_uv, which says where on the scalp their appearance is stored")
        return self.root_uv

    def select(self, index: Tensor) -> "Strands":
        """Keep the strands selected by `index` (integers or booleans), with their attributes."""
        return self._changed(lambda value: value[index])

    def to(self, device: torch.device | str) -> "Strands":
        """Move every tensor to `device`."""
        return self._changed(lambda value: value.to(device))

    def _changed(self, change: Callable[[Tensor], Tensor]) -> "Strands":
        """Apply `change` to every tensor that is present."""
        present = {field.name: value for field in fields(self) if (value := getattr(self, field.name)) is not None}
        return replace(self, **{name: change(value) for name, value in present.items()})


def segments(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point-1 3"]:
    """Forward differences d_k = p_{k+1} - p_k."""
    return points[:, 1:] - points[:, :-1]


def directions(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point 3"]:
    """Unit growth direction at each point: the forward difference; the last point repeats the previous direction."""
    forward = torch.nn.functional.normalize(segments(points), dim=-1)
    return torch.cat([forward, forward[:, -1:]], dim=1)


def lengths(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, " strand"]:
    """Arc length of each polyline in metres."""
    return segments(points).norm(dim=-1).sum(dim=-1)


def lengths_along(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
    """Arc length from the root to every point, metres."""
    return torch.nn.functional.pad(segments(points).norm(dim=-1).cumsum(dim=-1), (1, 0))
