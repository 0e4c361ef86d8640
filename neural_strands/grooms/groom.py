"""A groom: strands of any number of points each, as stored in files."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.resample import resample_ragged
from neural_strands.geometry.strands import Strands

ATTRIBUTES = ("root_uv", "root_normal", "width", "color", "unseen", "t")
"""Optional attributes of a groom besides its points."""
OF_POINTS = ("width", "t")
"""Attributes with a row per vertex; the others have one per strand."""


@dataclass(frozen=True)
class Groom:
    """Ragged strands, root first, one after the other.

    A groom is in the unit and axes of its file (USD states both and is converted to metres, y up). Everything that
    takes `Strands` expects metres, y up, +z front, so convert before calling `strands()`.

    Attributes:
        vertices: the points of all strands.
        offsets: where each strand starts among the vertices, and the total at the end.
        root_uv: coordinates of each root on the scalp chart.
        root_normal: outward normal of the scalp at each root.
        width: full thickness at each vertex, in the unit of the vertices.
        color: linear RGB of each strand in [0, 1].
        unseen: share of each strand's points that no photograph could see, in [0, 1].
        t: parameter of each vertex on the strand as it was fitted (`geometry.strands.Strands.t`).

    Examples:
        >>> import torch
        >>> import neural_strands as ns
        >>> vertices = torch.tensor([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1], [1, 0, 3]])
        >>> groom = ns.Groom(vertices, offsets=torch.tensor([0, 2, 5]))
        >>> len(groom), groom.lengths().tolist()
        (2, [1.0, 3.0])
        >>> groom.strands(points=4).points.shape
        torch.Size([2, 4, 3])
    """

    vertices: Float[Tensor, "vertex 3"]
    offsets: Int64[Tensor, " strand_plus_one"]
    root_uv: Float[Tensor, "strand 2"] | None = None
    root_normal: Float[Tensor, "strand 3"] | None = None
    width: Float[Tensor, " vertex"] | None = None
    color: Float[Tensor, "strand 3"] | None = None
    unseen: Float[Tensor, " strand"] | None = None
    t: Float[Tensor, " vertex"] | None = None

    def __post_init__(self) -> None:
        if len(self.offsets) == 0 or int(self.offsets[0]) != 0 or int(self.offsets[-1]) != len(self.vertices):
            raise ValueError(f"offsets must run from 0 to {len(self.vertices)} vertices, found {self.offsets}")
        if bool((self.sizes < 2).any()):
            raise ValueError("a strand needs at least two points")
        for name in ATTRIBUTES:
            value, count = getattr(self, name), len(self.vertices) if name in OF_POINTS else len(self)
            if value is not None and len(value) != count:
                raise ValueError(f"{name}: expected {count} rows, found {tuple(value.shape)}")

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @classmethod
    def from_strands(cls, strands: Strands) -> "Groom":
        """Build a groom from strands of equal point counts; nothing is resampled."""
        count, points, _ = strands.points.shape
        return cls(
            vertices=strands.points.reshape(-1, 3),
            offsets=torch.arange(count + 1, device=strands.points.device) * points,
            root_uv=strands.root_uv,
            root_normal=strands.root_normal,
            width=None if strands.width is None else strands.width.reshape(-1),
            color=strands.color,
            unseen=strands.unseen,
            t=None if strands.t is None else strands.t.reshape(-1),
        )

    @property
    def sizes(self) -> Int64[Tensor, " strand"]:
        """Number of points of each strand."""
        return self.offsets[1:] - self.offsets[:-1]

    @property
    def uniform_size(self) -> int | None:
        """Number of points per strand if it is the same for all, else None."""
        sizes = self.sizes
        return int(sizes[0]) if len(sizes) and bool((sizes == sizes[0]).all()) else None

    @property
    def roots(self) -> Float[Tensor, "strand 3"]:
        """First point of each strand."""
        return self.vertices[self.offsets[:-1]]

    def lengths(self) -> Float[Tensor, " strand"]:
        """Length of each polyline, in the unit of the vertices, double precision."""
        return _arc(self)[self.offsets[1:] - 1]

    def strands(self, points: int | None = 100) -> Strands:
        """Return strands of `points` points each, equally spaced in arc length along a spline (geometry.resample).

        Widths and t are interpolated linearly in arc length. With None the points stay as they are.

        Raises:
            ValueError: `points` is None and the strands have different numbers of points.
        """
        if points is None:
            if (size := self.uniform_size) is None:
                raise ValueError("strands of differing point counts cannot be stacked; say how many points you want")
            positions = self.vertices.reshape(len(self), size, 3)
            width, t = (None if each is None else each.reshape(len(self), size) for each in (self.width, self.t))
        else:
            positions = resample_ragged(self.vertices, self.offsets, points)
            width, t = (None if each is None else _resampled(self, each, points) for each in (self.width, self.t))
        return Strands(positions, self.root_uv, self.root_normal, width, self.color, self.unseen, t)

    def transformed(self, rotation: Float[Tensor, "3 3"], scale: float) -> "Groom":
        """Rotate (new = rotation @ old), then scale every length."""
        normal = None if self.root_normal is None else self.root_normal @ rotation.T
        return replace(
            self,
            vertices=(self.vertices @ rotation.T) * scale,
            root_normal=normal,
            width=None if self.width is None else self.width * scale,
        )

    def to(self, device: torch.device | str) -> "Groom":
        """Move every tensor to `device`."""
        moved = {name: None if (value := getattr(self, name)) is None else value.to(device) for name in ATTRIBUTES}
        return Groom(self.vertices.to(device), self.offsets.to(device), **moved)


def _arc(groom: Groom) -> Float[Tensor, " vertex"]:
    """Arc length from each vertex's root, in double precision."""
    vertices = groom.vertices.double()
    step = torch.zeros(len(vertices), dtype=torch.float64, device=vertices.device)
    step[1:] = (vertices[1:] - vertices[:-1]).norm(dim=-1)
    step[groom.offsets[:-1]] = 0.0
    total = step.cumsum(dim=0)
    return total - total[groom.offsets[:-1]].repeat_interleave(groom.sizes)


def _resampled(groom: Groom, values: Float[Tensor, " vertex"], points: int) -> Float[Tensor, "strand {points}"]:
    """Resample values at `points` equal steps of arc length."""
    arc, sizes, last = _arc(groom), groom.sizes, groom.offsets[1:] - 1
    strand = torch.arange(len(groom), device=arc.device, dtype=torch.float64)
    key = arc / arc[last].repeat_interleave(sizes).clamp(min=1e-300) + strand.repeat_interleave(sizes)
    target = torch.linspace(0.0, 1.0, points, dtype=torch.float64, device=arc.device) + strand[:, None]
    right = torch.searchsorted(key, target)
    right = right.clamp(min=(groom.offsets[:-1] + 1)[:, None], max=last[:, None])
    span = (key[right] - key[right - 1]).clamp(min=1e-15)
    weight = ((target - key[right - 1]) / span).clamp(0.0, 1.0).to(values.dtype)
    return values[right - 1] * (1 - weight) + values[right] * weight
