"""Warp kernels that test points in views: whether they are visible, or seen to be empty (`geometry.visual_hull`)."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.func
@no_type_check
def pixel_of(point: wp.vec3, projection: wp.mat44, width: int, height: int) -> wp.vec2i:
    """Column and row of the pixel that shows a point; -1 if it is outside the picture."""
    image = projection * wp.vec4(point[0], point[1], point[2], 1.0)
    if image[2] <= 0.0:
        return wp.vec2i(-1, -1)
    u = image[0] / image[2]
    v = image[1] / image[2]
    if u < 0.0 or v < 0.0 or u >= float(width) or v >= float(height):
        return wp.vec2i(-1, -1)
    return wp.vec2i(int(u), int(v))


@wp.func
@no_type_check
def before_head(
    point: wp.vec3,
    centre: wp.vec3,
    pixel: wp.vec2i,
    width: int,
    height: int,
    head: wp.array2d[float],
) -> bool:
    """Whether a point is no farther from the camera's centre than the head along the ray through its pixel."""
    row = wp.min(pixel[1] * head.shape[0] // height, head.shape[0] - 1)
    column = wp.min(pixel[0] * head.shape[1] // width, head.shape[1] - 1)
    return wp.length(point - centre) <= head[row, column]


@wp.func
@no_type_check
def seen_empty(
    point: wp.vec3,
    projection: wp.mat44,
    centre: wp.vec3,
    head: wp.array2d[float],
    hair: wp.array(dtype=wp.uint8, ndim=2),
) -> bool:
    """Whether a view sees a point in front of the head in a pixel without hair; false outside the picture."""
    width = hair.shape[1]
    height = hair.shape[0]
    pixel = pixel_of(point, projection, width, height)
    if pixel[0] < 0 or hair[pixel[1], pixel[0]] > wp.uint8(0):
        return False
    return before_head(point, centre, pixel, width, height, head)


@wp.kernel(enable_backward=False)
@no_type_check
def carve_nodes(
    start: int,
    origin: wp.vec3,
    spacing: float,
    shape: wp.vec3i,
    projection: wp.mat44,
    centre: wp.vec3,
    head: wp.array2d[float],
    hair: wp.array(dtype=wp.uint8, ndim=2),
    witnesses: wp.array[wp.uint8],
) -> None:
    """Count down the witnesses that the nodes of a grid still need, where a view sees them to be empty."""
    i = start + wp.tid()
    if witnesses[i] == wp.uint8(0):
        return
    row = i // shape[2]
    point = origin + wp.vec3(float(row // shape[1]), float(row % shape[1]), float(i % shape[2])) * spacing
    if seen_empty(point, projection, centre, head, hair):
        witnesses[i] -= wp.uint8(1)


@wp.kernel(enable_backward=False)
@no_type_check
def carve_points(
    start: int,
    points: wp.array[wp.vec3],
    projection: wp.mat44,
    centre: wp.vec3,
    head: wp.array2d[float],
    hair: wp.array(dtype=wp.uint8, ndim=2),
    witnesses: wp.array[wp.uint8],
) -> None:
    """Count down the witnesses that points still need, where a view sees them to be empty."""
    i = start + wp.tid()
    if witnesses[i] > wp.uint8(0) and seen_empty(points[i], projection, centre, head, hair):
        witnesses[i] -= wp.uint8(1)


@wp.kernel(enable_backward=False)
@no_type_check
def count_views(
    start: int,
    points: wp.array[wp.vec3],
    outward: wp.array[wp.vec3],
    least_cosine: float,
    projection: wp.mat44,
    centre: wp.vec3,
    head: wp.array2d[float],
    width: int,
    height: int,
    count: wp.array[int],
) -> None:
    """Count the view for points that it sees from their outward side, in front of the head."""
    i = start + wp.tid()
    towards = wp.normalize(centre - points[i])
    if wp.dot(towards, outward[i]) < least_cosine:
        return
    pixel = pixel_of(points[i], projection, width, height)
    if pixel[0] >= 0 and before_head(points[i], centre, pixel, width, height, head):
        count[i] += 1
