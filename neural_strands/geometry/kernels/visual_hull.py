"""Warp kernels that carve away what views see to be empty (see `geometry.visual_hull`)."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.func
@no_type_check
def seen_empty(
    point: wp.vec3,
    projection: wp.mat44,
    centre: wp.vec3,
    hair: wp.array(dtype=wp.uint8, ndim=2),
    head: wp.array(dtype=wp.float32, ndim=2),
) -> bool:
    """Whether a view sees a point outside its mask in front of the head; outside the picture nothing is known."""
    image = projection * wp.vec4(point[0], point[1], point[2], 1.0)
    if image[2] <= 0.0:
        return False
    u = image[0] / image[2]
    v = image[1] / image[2]
    if u < 0.0 or v < 0.0 or u >= float(hair.shape[1]) or v >= float(hair.shape[0]):
        return False
    row = int(v)
    column = int(u)
    if hair[row, column] > wp.uint8(0):
        return False
    head_row = wp.min(row * head.shape[0] // hair.shape[0], head.shape[0] - 1)
    head_column = wp.min(column * head.shape[1] // hair.shape[1], head.shape[1] - 1)
    return wp.length(point - centre) <= head[head_row, head_column]


@wp.kernel(enable_backward=False)
@no_type_check
def carve_nodes(
    start: int,
    origin: wp.vec3,
    spacing: float,
    shape: wp.vec3i,
    projection: wp.mat44,
    centre: wp.vec3,
    hair: wp.array(dtype=wp.uint8, ndim=2),
    head: wp.array(dtype=wp.float32, ndim=2),
    kept: wp.array[wp.uint8],
) -> None:
    """Drop the nodes of a grid that a view sees empty."""
    i = start + wp.tid()
    if kept[i] == wp.uint8(0):
        return
    row = i // shape[2]
    point = origin + wp.vec3(float(row // shape[1]), float(row % shape[1]), float(i % shape[2])) * spacing
    if seen_empty(point, projection, centre, hair, head):
        kept[i] = wp.uint8(0)


@wp.kernel(enable_backward=False)
@no_type_check
def carve_points(
    start: int,
    points: wp.array[wp.vec3],
    projection: wp.mat44,
    centre: wp.vec3,
    hair: wp.array(dtype=wp.uint8, ndim=2),
    head: wp.array(dtype=wp.float32, ndim=2),
    kept: wp.array[wp.uint8],
) -> None:
    """Drop the points that a view sees empty."""
    i = start + wp.tid()
    if kept[i] > wp.uint8(0) and seen_empty(points[i], projection, centre, hair, head):
        kept[i] = wp.uint8(0)
