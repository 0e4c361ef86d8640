"""Resampling of polylines by arc length along a spline through their points."""

from dataclasses import replace

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.spline import Splines, fit_splines
from neural_strands.geometry.strands import Strands, segments

MINIMUM_STEP = 1e-9
"""Chord (metres) added to every segment so that repeated points keep a strictly increasing parameter."""
SUBSTEPS = 16
"""Number of chords that measure the arc length of each segment of a spline."""
BLOCK = 4096
"""Number of strands resampled together, to bound memory."""
SAMPLES = 2**16
"""Number of samples that the CPU evaluates at a time (docs/experiments/speed.md)."""


def resample_polyline_lengths(points: Float[Tensor, "strand point 3"], count: int) -> Float[Tensor, "strand {count} 3"]:
    """Resample piecewise linear strands to `count` points equally spaced in arc length; differentiable.

    Raises:
        ValueError: fewer than two points in or out.
    """
    strand_count, point_count, _ = points.shape
    if point_count < 2 or count < 2:
        raise ValueError(f"resampling needs at least two points, found {point_count} in and {count} out")
    if strand_count == 0:
        return points.new_zeros(0, count, 3)
    step = segments(points).norm(dim=-1) + MINIMUM_STEP
    arc = torch.cat([step.new_zeros(strand_count, 1), step.cumsum(dim=-1)], dim=-1)
    target = arc[:, -1:] * torch.linspace(0.0, 1.0, count, dtype=points.dtype, device=points.device)
    right = torch.searchsorted(arc.detach(), target.detach()).clamp(1, point_count - 1)
    left_arc, right_arc = arc.gather(1, right - 1), arc.gather(1, right)
    weight = ((target - left_arc) / (right_arc - left_arc)).clamp(0.0, 1.0)[..., None]
    gathered = [points.gather(1, index[..., None].expand(-1, -1, 3)) for index in (right - 1, right)]
    return gathered[0] * (1 - weight) + gathered[1] * weight


def resample_strands(points: Float[Tensor, "strand point 3"], count: int) -> Float[Tensor, "strand {count} 3"]:
    """Resample strands to `count` points equally spaced in arc length along a cubic spline through their points.

    The spline has chord-length knots and parabolic ends (see `geometry.spline`); end points are preserved.
    Differentiable.

    Raises:
        ValueError: fewer than two points in or out.
    """
    if points.shape[1] < 3 or len(points) == 0:
        return resample_polyline_lengths(points, count)
    sizes = torch.full((len(points),), points.shape[1], dtype=torch.int64, device=points.device)
    return _resample_padded(points, sizes, count)[0]


def resample(strands: Strands, count: int) -> Strands:
    """Resample strands like `resample_strands`, with the attributes of their points; differentiable.

    The parameter t and the width are interpolated linearly within each segment, without a gradient to the points. The
    result always stores t, because points that are evenly spaced in arc length need not be so in t.

    Raises:
        ValueError: fewer than two points in or out.
    """
    sizes = torch.full((len(strands),), strands.points_per_strand, dtype=torch.int64, device=strands.points.device)
    carried = [strands.parameters()] if strands.width is None else [strands.parameters(), strands.width]
    points, places = _resample_padded(strands.points, sizes, count)
    whole = places.detach().long().clamp(max=strands.points_per_strand - 2)
    fraction = places.detach() - whole
    t, *width = (
        torch.lerp(value.gather(1, whole), value.gather(1, whole + 1), fraction.to(value)) for value in carried
    )
    return replace(strands, points=points, t=t, width=width[0] if width else None)


def interpolate_evenly(
    values: Float[Tensor, "strand point *channel"], count: int
) -> Float[Tensor, "strand {count} *channel"]:
    """Interpolate values at the points of strands linearly to `count` places, evenly spaced in the point's index."""
    last = values.shape[1] - 1
    place = torch.linspace(0, last, count, device=values.device)
    before = place.long().clamp(max=last - 1)
    share = (place - before).reshape(-1, *(1 for _ in values.shape[2:]))
    return torch.lerp(values[:, before], values[:, before + 1], share)


def resample_ragged(
    vertices: Float[Tensor, "vertex 3"], offsets: Int64[Tensor, " strands_plus_one"], count: int
) -> Float[Tensor, "strand {count} 3"]:
    """Resample polylines with different numbers of points to `count` points each (see `resample_strands`).

    Args:
        vertices: points of all strands, concatenated.
        offsets: start of each strand, followed by the total number of points.
        count: points per strand in the result.

    Raises:
        ValueError: fewer than two points in or out.
    """
    sizes = offsets[1:] - offsets[:-1]
    if len(sizes) == 0:
        return vertices.new_zeros(0, count, 3)
    # Strands of similar size share a block, so that there is little padding.
    order = torch.argsort(sizes)
    parts = []
    for chosen in order.split(BLOCK):
        step = torch.arange(int(sizes[chosen].max()), device=offsets.device)
        index = offsets[chosen, None] + torch.minimum(step, sizes[chosen, None] - 1)
        parts.append(_resample_padded(vertices[index], sizes[chosen], count)[0])
    return torch.cat(parts)[torch.argsort(order)]


def _resample_padded(
    points: Float[Tensor, "strand point 3"], sizes: Int64[Tensor, " strand"], count: int
) -> tuple[Float[Tensor, "strand {count} 3"], Float[Tensor, "strand {count}"]]:
    """Resample the first `sizes` points of each row, a block of rows at a time.

    Returns:
        Points, and their positions: index of the segment's first point plus the fraction of the segment.
    """
    fewest = int(sizes.min()) if len(sizes) else points.shape[1]
    if count < 2 or fewest < 2:
        raise ValueError(f"resampling needs at least two points, found {fewest} in and {count} out")
    parts = [
        _resample_block(block.double(), size, count)
        for block, size in zip(points.split(BLOCK), sizes.split(BLOCK), strict=True)
    ]
    resampled, places = (torch.cat(part) for part in zip(*parts, strict=True))
    return resampled.to(points.dtype), places


def _resample_block(
    points: Float[Tensor, "strand point 3"], sizes: Int64[Tensor, " strand"], count: int
) -> tuple[Float[Tensor, "strand {count} 3"], Float[Tensor, "strand {count}"]]:
    """Points on the spline at equal steps of its arc length, which is measured on SUBSTEPS chords per segment."""
    strands, size, _ = points.shape
    splines = fit_splines(points, sizes)
    position = torch.arange((size - 1) * SUBSTEPS + 1, dtype=points.dtype, device=points.device) / SUBSTEPS
    segment = position.long().clamp(max=size - 2).expand(strands, -1)
    # Beyond a strand's last point the samples repeat it, and the arc length stays constant.
    ended = position >= (sizes - 1)[:, None]
    segment = torch.minimum(segment, (sizes - 2)[:, None])
    fraction = torch.where(ended, 1.0, position - segment)
    arc = _chords(splines, segment, fraction).cumsum(dim=1)
    arc = torch.cat([arc.new_zeros(strands, 1), arc], dim=1)
    target = arc[:, -1:] * torch.linspace(0.0, 1.0, count, dtype=points.dtype, device=points.device)
    final = (sizes - 1)[:, None] * SUBSTEPS
    right = torch.searchsorted(arc.detach(), target.detach()).clamp(min=1)
    right = torch.minimum(right, final)
    left_arc, right_arc = arc.gather(1, right - 1), arc.gather(1, right)
    weight = ((target - left_arc) / (right_arc - left_arc).clamp(min=1e-300)).clamp(0.0, 1.0)
    place = (right - 1 + weight) / SUBSTEPS
    segment = torch.minimum(place.detach().long(), (sizes - 2)[:, None])
    return splines.evaluate(segment, place - segment), place


def _chords(
    splines: Splines, segment: Int64[Tensor, "strand sample"], fraction: Float[Tensor, "strand sample"]
) -> Float[Tensor, "strand sample-1"]:
    """Distances between samples that follow each other, some strands at a time."""
    strands = max(1, SAMPLES // segment.shape[1] if segment.device.type == "cpu" else len(segment))
    parts = []
    for number, (where, along) in enumerate(zip(segment.split(strands), fraction.split(strands), strict=True)):
        samples = splines.select(slice(number * strands, (number + 1) * strands)).evaluate(where, along)
        parts.append((samples[:, 1:] - samples[:, :-1]).norm(dim=-1))
    return torch.cat(parts)
