"""Warp kernel that rotates the segments of strands like those of their guides (see `editing.rods.follow`)."""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def turn_steps(
    start: int,
    turns: wp.array2d[wp.quat],
    spacing: wp.array[float],
    guides: wp.array2d[int],
    weights: wp.array2d[float],
    arc: wp.array2d[float],
    steps: wp.array2d[wp.vec3],
    turned: wp.array2d[wp.vec3],
) -> None:
    """Rotate each step by the mean rotation of the strand's guides at the same distance from the root."""
    strand = start + wp.tid()
    last = float(turns.shape[1] - 1)
    for k in range(steps.shape[1]):
        total = wp.quat(0.0, 0.0, 0.0, 0.0)
        for j in range(guides.shape[1]):
            guide = guides[strand, j]
            place = wp.clamp(arc[strand, k] / spacing[guide] - 0.5, 0.0, last)
            low = wp.min(int(place), turns.shape[1] - 2)
            low = wp.max(low, 0)
            high = wp.min(low + 1, turns.shape[1] - 1)
            ahead = place - float(low)
            for side in range(2):
                turn = turns[guide, wp.where(side == 0, low, high)]
                weight = weights[strand, j] * wp.where(side == 0, 1.0 - ahead, ahead)
                if wp.dot(total, turn) < 0.0:
                    weight = -weight
                total = total + weight * turn
        turned[strand, k] = wp.quat_rotate(wp.normalize(total), steps[strand, k])
