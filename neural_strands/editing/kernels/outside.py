"""Warp kernel that follows strands from their roots and keeps them out of a body (see `editing.outside`)."""

# Warp's kernel language is not Python's type system: these rules do not hold inside it.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.geometry.kernels.voxel_grid import blend, last_node, lowest_corner, slope


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
    """Add steps to the first point of each strand; a step that would end inside is turned, not shortened."""
    strand = start + wp.tid()
    here = points[strand, 0]
    last = last_node(shape)
    for k in range(steps.shape[1]):
        step = steps[strand, k]
        length = wp.length(step)
        target = here + step
        for _ in range(rounds):
            raw = (target - origin) / spacing
            place = wp.min(wp.max(raw, wp.vec3(0.0)), last)
            corner = lowest_corner(place, shape)
            ahead = place - wp.vec3(float(corner[0]), float(corner[1]), float(corner[2]))
            missing = clearance[strand, k + 1] - blend(values, corner, ahead)
            if missing <= 0.0:
                break
            outward = wp.normalize(slope(values, corner, ahead))
            turned = target + missing * outward - here
            target = here + length * wp.normalize(turned)
        here = target
        points[strand, k + 1] = here
