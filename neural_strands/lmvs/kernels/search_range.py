"""Warp kernel that finds where rays enter a carved volume."""

# ruff: noqa: UP018  (to Warp, the cast makes a variable of a constant)
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.geometry.kernels.voxel_grid import trilinear


@wp.kernel(enable_backward=False)
@no_type_check
def enter(
    start: int,
    origin: wp.vec3,
    spacing: float,
    occupancy: wp.array3d[float],
    centre: wp.vec3,
    ray: wp.array[wp.vec3],
    stop: wp.array[float],
    begin: float,
    end: float,
    entry: wp.array[float],
    normal: wp.array[wp.vec3],
) -> None:
    """March each ray from `begin` to where the smoothed volume exceeds one half; its gradient is the normal."""
    i = start + wp.tid()
    entry[i] = -1.0
    normal[i] = -ray[i]
    last = wp.min(end, stop[i] + 4.0 * spacing)
    distance = begin
    previous = float(0.0)
    while distance < last:
        place = (centre + ray[i] * distance - origin) / spacing
        value = trilinear(occupancy, place)
        if value > 0.5:
            back = 0.5 * spacing * (value - 0.5) / wp.max(value - previous, 1.0e-3)
            entry[i] = distance - wp.min(back, 0.5 * spacing)
            x = wp.vec3(1.5, 0.0, 0.0)
            y = wp.vec3(0.0, 1.5, 0.0)
            z = wp.vec3(0.0, 0.0, 1.5)
            gradient = wp.vec3(
                trilinear(occupancy, place + x) - trilinear(occupancy, place - x),
                trilinear(occupancy, place + y) - trilinear(occupancy, place - y),
                trilinear(occupancy, place + z) - trilinear(occupancy, place - z),
            )
            if wp.length(gradient) > 1.0e-4:
                outward = -wp.normalize(gradient)
                # Normals at grazing angles are unreliable, so they are turned towards the camera.
                normal[i] = wp.normalize(outward - ray[i] * 0.5)
            return
        previous = value
        distance += 0.5 * spacing
