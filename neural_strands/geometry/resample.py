"""Resampling of polylines by arc length along a spline through their points."""

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.interpolate import CubicSpline
from torch import Tensor

from neural_strands.geometry.strands import segments

MINIMUM_STEP = 1e-9
"""Chord (metres) added to every segment so that repeated points keep a strictly increasing parameter."""


def resample_polyline_lengths(points: Float[Tensor, "strand point 3"], count: int) -> Float[Tensor, "strand {count} 3"]:
    """Resample piecewise linear strands to `count` points equally spaced in arc length; differentiable.

    Raises:
        ValueError: fewer than two points in or out.
    """
    strand_count, point_count, _ = points.shape
    if point_count < 2 or count < 2:
        raise ValueError(f"resampling needs at least two points, got {point_count} in and {count} out")
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

    The spline has natural-like not-a-knot ends and is parametrised by chord length, so end points are kept.

    Raises:
        ValueError: fewer than two points in or out.
    """
    if points.shape[1] < 3 or len(points) == 0:
        return resample_polyline_lengths(points, count)
    dense = 8 * max(count, points.shape[1])
    return resample_polyline_lengths(_spline(points, dense), count)


def resample_ragged(
    vertices: Float[Tensor, "vertex 3"], offsets: Int64[Tensor, " strands_plus_one"], count: int
) -> Float[Tensor, "strand {count} 3"]:
    """Resample polylines of differing point counts to `count` points each (see `resample_strands`).

    Args:
        vertices: the points of all strands, one strand after the other.
        offsets: where each strand starts, and the total at the end.
        count: points a strand wanted.
    """
    sizes = offsets[1:] - offsets[:-1]
    result = vertices.new_zeros(len(sizes), count, 3)
    for size in torch.unique(sizes).tolist():
        chosen = torch.nonzero(sizes == size).squeeze(1)
        index = offsets[chosen, None] + torch.arange(size, device=offsets.device)
        result[chosen] = resample_strands(vertices[index], count)
    return result


def _spline(points: Float[Tensor, "strand point 3"], count: int) -> Float[Tensor, "strand {count} 3"]:
    """Evaluate chord-length cubic splines at `count` parameters each."""
    array = points.detach().cpu().double().numpy()
    chord = np.linalg.norm(np.diff(array, axis=1), axis=-1) + MINIMUM_STEP
    knots = np.concatenate([np.zeros((len(array), 1)), np.cumsum(chord, axis=1)], axis=1)
    fractions = np.linspace(0.0, 1.0, count)
    curves = np.stack(
        [CubicSpline(knot, curve)(fractions * knot[-1]) for knot, curve in zip(knots, array, strict=True)]
    )
    return torch.from_numpy(curves).to(points)
