"""Warp kernels of a haircut (see `editing.haircut`)."""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def sum_lengths(start: int, points: wp.array2d[wp.vec3], arc: wp.array2d[float]) -> None:
    """Length of a strand up to each of its points."""
    strand = start + wp.tid()
    gone = wp.float64(0.0)
    for k in range(1, points.shape[1]):
        gone += wp.float64(wp.length(points[strand, k] - points[strand, k - 1]))
        arc[strand, k] = float(gone)


@wp.kernel(enable_backward=False)
@no_type_check
def spread_points(
    start: int,
    last: wp.array[float],
    points: wp.array2d[wp.vec3],
    t: wp.array2d[float],
    width: wp.array2d[float],
    new_points: wp.array2d[wp.vec3],
    new_t: wp.array2d[float],
    new_width: wp.array2d[float],
) -> None:
    """Move the points of a strand so that the last one is at `last`, a fractional index of points."""
    strand = start + wp.tid()
    count = points.shape[1]
    for k in range(count):
        place = last[strand] * float(k) / float(count - 1)
        low = wp.clamp(int(place), 0, count - 2)
        ahead = place - float(low)
        new_points[strand, k] = wp.lerp(points[strand, low], points[strand, low + 1], ahead)
        new_t[strand, k] = wp.lerp(t[strand, low], t[strand, low + 1], ahead)
        new_width[strand, k] = wp.lerp(width[strand, low], width[strand, low + 1], ahead)
