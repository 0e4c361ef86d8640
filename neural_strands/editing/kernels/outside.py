"""Warp kernel that follows strands from their roots and keeps them out of a body (see `editing.outside`)."""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.geometry.kernels.voxel_grid import blend, cell_about, nearest_place, slope

STEEPEST = wp.constant(1.75)
"""Largest slope of trilinearly interpolated distances: at most 1 along each axis, so the square root of 3 in total."""


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
        length = wp.length(step)
        target = here + step
        apart -= STEEPEST * length
        if apart < clearance[strand, k + 1]:
            apart = float(-wp.inf)
            for _ in range(rounds):
                cell = cell_about(nearest_place((target - origin) / spacing, shape), shape)
                distance = blend(values, cell)
                missing = clearance[strand, k + 1] - distance
                if missing <= 0.0:
                    apart = distance
                    break
                outward = wp.normalize(slope(values, cell))
                turned = target + missing * outward - here
                target = here + length * wp.normalize(turned)
        here = target
        points[strand, k + 1] = here
