"""Warp kernel that follows strands from their roots and keeps them out of a body (see `editing.outside`)."""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.geometry.kernels.voxel_grid import blend, cell_about, nearest_place, slope

STEEPEST = wp.constant(1.75)
"""Largest slope of trilinearly interpolated distances: at most 1 along each axis, so the square root of 3 in total."""


@wp.func
@no_type_check
def raised(step: wp.vec3, outward: wp.vec3, missing: float) -> wp.vec3:
    """A step rotated towards the unit vector `outward`, so that it ends higher by `missing` if it is long enough."""
    length = wp.length(step)
    up = wp.dot(step, outward)
    flat = step - up * outward
    aside = wp.length(flat)
    if aside < 1.0e-4 * length:
        # Straight up or down: any direction aside will do.
        flat = wp.cross(outward, wp.where(wp.abs(outward[0]) < 0.5, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0)))
        aside = wp.length(flat)
    up = wp.min(up + missing, length)
    # Normalised, because `flat` is the difference of two similar vectors and not quite horizontal.
    return length * wp.normalize(up * outward + (wp.sqrt(wp.max(length * length - up * up, 0.0)) / aside) * flat)


@wp.kernel(enable_backward=False)
@no_type_check
def follow_outside(
    start: int,
    origin: wp.vec3,
    spacing: float,
    shape: wp.vec3i,
    values: wp.array3d[float],
    steps: wp.array2d[wp.vec3],
    clearance: wp.array2d[float],
    rounds: int,
    points: wp.array2d[wp.vec3],
) -> None:
    """Add steps to the first point of each strand; a step that would end inside is rotated, not shortened."""
    strand = start + wp.tid()
    here = points[strand, 0]
    # A lower bound of the point's distance: while it is large enough, the slow lookup in the grid is skipped.
    apart = float(-wp.inf)
    for k in range(steps.shape[1]):
        step = steps[strand, k]
        target = here + step
        apart -= STEEPEST * wp.length(step)
        if apart < clearance[strand, k + 1]:
            apart = float(-wp.inf)
            for _ in range(rounds):
                cell = cell_about(nearest_place((target - origin) / spacing, shape), shape)
                distance = blend(values, cell)
                missing = clearance[strand, k + 1] - distance
                if missing <= 0.0:
                    apart = distance
                    break
                step = raised(step, wp.normalize(slope(values, cell)), missing)
                target = here + step
        here = target
        points[strand, k + 1] = here
