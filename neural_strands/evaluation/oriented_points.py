"""Oriented points, sampled evenly along grooms and line segments, for the geometry metrics."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from neural_strands.geometry.line_segments import LineSegments

STEP = 5e-4
"""Largest distance between neighbouring samples of a curve, metres."""
MOST_SAMPLES = 200_000_000
"""Largest number of samples of all curves together, about twenty gigabytes."""
ROUNDING = 1e-4
"""Share of a step by which rounding errors may lengthen a curve without adding a sample."""
SAME_POINT = 1e-8
"""A vertex this close to the previous one (metres) has no direction and is skipped."""


@dataclass(frozen=True)
class OrientedPoints:
    """Points of curves with unit directions.

    Attributes:
        points: positions, metres; the points of one curve are consecutive, from its root.
        directions: unit tangents.
        curve: index of each point's curve, non-decreasing.
        step_index: index of each point on its curve, from 0 at the root.
    """

    points: Float[Tensor, "point 3"]
    directions: Float[Tensor, "point 3"]
    curve: Int64[Tensor, " point"]
    step_index: Int64[Tensor, " point"]

    def __len__(self) -> int:
        return self.points.shape[0]

    def to(self, device: torch.device | str) -> "OrientedPoints":
        """Move every tensor to `device`."""
        return OrientedPoints(
            self.points.to(device), self.directions.to(device), self.curve.to(device), self.step_index.to(device)
        )

    def thinned(self, every: int) -> "OrientedPoints":
        """Every n-th point of each curve, starting with its first."""
        kept = self.selected(self.step_index % every == 0)
        return OrientedPoints(kept.points, kept.directions, kept.curve, kept.step_index // every)

    def selected(self, keep: Bool[Tensor, " point"]) -> "OrientedPoints":
        """The points that are marked."""
        return OrientedPoints(self.points[keep], self.directions[keep], self.curve[keep], self.step_index[keep])

    def roots(self) -> Float[Tensor, "curve 3"]:
        """First point of each curve."""
        return self.points[self.step_index == 0]


def sample_curves(
    vertices: Float[Tensor, "vertex 3"],
    offsets: Int64[Tensor, " curve_plus_one"],
    step: float = STEP,
    directions: Float[Tensor, "vertex 3"] | None = None,
) -> OrientedPoints:
    """Sample polylines at equal steps of arc length, `step` metres or slightly less, both ends included.

    Args:
        vertices: points of all curves, concatenated, metres.
        offsets: start of each curve, followed by the total number of points.
        step: largest distance between samples, metres.
        directions: unit direction at each vertex; by default that of the polyline itself.

    Returns:
        The samples; a curve with one vertex or without length yields one sample if `directions` are given, else none.

    Raises:
        ValueError: there would be more than `MOST_SAMPLES` of them.
    """
    vertices, curve, given = _without_repeats(vertices, offsets, directions)
    count = len(offsets) - 1
    sizes = torch.bincount(curve, minlength=count)
    ends = sizes.cumsum(0)
    first, last = (ends - sizes)[sizes > 0], ends[sizes > 0] - 1
    identity = torch.nonzero(sizes).squeeze(1)
    chord = vertices.new_zeros(len(vertices), dtype=torch.float64)
    chord[1:] = (vertices[1:] - vertices[:-1]).double().norm(dim=-1)
    chord[first] = 0.0
    arc = chord.cumsum(0)
    length = arc[last] - arc[first]
    samples = torch.where(length > 0, torch.ceil(length / step - ROUNDING).long() + 1, 1)
    if (total := int(samples.sum())) > MOST_SAMPLES:
        raise ValueError(f"curves of at most {MOST_SAMPLES} samples, found {total} at a step of {step:g} m")
    which = torch.repeat_interleave(torch.arange(len(samples), device=vertices.device), samples)
    number = torch.arange(len(which), device=vertices.device) - (samples.cumsum(0) - samples)[which]
    target = arc[first][which] + length[which] * number / (samples[which] - 1).clamp(min=1)
    right = torch.searchsorted(arc, target)
    right = torch.minimum(torch.maximum(right, first[which] + 1), last[which])
    left = torch.maximum(right - 1, first[which])
    weight = ((target - arc[left]) / (arc[right] - arc[left]).clamp(min=1e-300)).clamp(0.0, 1.0).to(vertices.dtype)
    points = torch.lerp(vertices[left], vertices[right], weight[:, None])
    if given is None:
        tangent = vertices[right] - vertices[left]
    else:
        tangent = torch.where((weight < 0.5)[:, None], given[left], given[right])
    tangent = torch.nn.functional.normalize(tangent, dim=-1)
    kept = OrientedPoints(points, tangent, identity[which], number)
    pointed = tangent.square().sum(-1) > 0
    if pointed.all():
        return kept
    return OrientedPoints(points[pointed], tangent[pointed], kept.curve[pointed], number[pointed])


def sample_strands(points: Float[Tensor, "strand point 3"], step: float = STEP) -> OrientedPoints:
    """Sample strands of equal point counts (see `sample_curves`)."""
    count, size, _ = points.shape
    offsets = torch.arange(count + 1, device=points.device) * size
    return sample_curves(points.reshape(-1, 3), offsets, step)


def sample_segments(segments: LineSegments, step: float = STEP) -> OrientedPoints:
    """Sample line segments along their chains, with their stored directions (see `sample_curves`)."""
    sizes = torch.bincount(segments.segment_id, minlength=segments.segment_count)
    offsets = torch.cat([sizes.new_zeros(1), sizes.cumsum(0)])
    return sample_curves(segments.points, offsets, step, segments.directions)


def _without_repeats(
    vertices: Float[Tensor, "vertex 3"],
    offsets: Int64[Tensor, " curve_plus_one"],
    directions: Float[Tensor, "vertex 3"] | None,
) -> tuple[Float[Tensor, "kept 3"], Int64[Tensor, " kept"], Float[Tensor, "kept 3"] | None]:
    """Drop vertices that coincide with the previous one; return the rest, their curves and their directions."""
    numbers = torch.arange(len(offsets) - 1, device=offsets.device)
    curve = torch.repeat_interleave(numbers, offsets[1:] - offsets[:-1])
    if len(vertices) == 0:
        return vertices, curve, directions
    moved = torch.ones(len(vertices), dtype=torch.bool, device=vertices.device)
    moved[1:] = ((vertices[1:] - vertices[:-1]).norm(dim=-1) > SAME_POINT) | (curve[1:] != curve[:-1])
    if moved.all():
        return vertices, curve, directions
    return vertices[moved], curve[moved], None if directions is None else directions[moved]
