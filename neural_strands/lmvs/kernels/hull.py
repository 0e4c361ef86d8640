"""Warp kernels that bound where hair can be: carving by masks, and rays against the head and the carved volume."""

# ruff: noqa: UP018  (Warp tells a variable from a constant by the cast)
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def trace_head(start: int, mesh: wp.uint64, centre: wp.vec3, ray: wp.array[wp.vec3], distance: wp.array[float]) -> None:
    """Distance along each unit ray to the head, or a large number."""
    i = start + wp.tid()
    hit = wp.mesh_query_ray(mesh, centre, ray[i], 1.0e6)
    distance[i] = 1.0e9
    if hit.result:
        distance[i] = hit.t


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
def carve(
    start: int,
    origin: wp.vec3,
    voxel: float,
    nodes: int,
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
    p = origin + wp.vec3(float(i // (nodes * nodes)), float((i // nodes) % nodes), float(i % nodes)) * voxel
    if seen_empty(p, projection, centre, hair, head):
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


@wp.kernel(enable_backward=False)
@no_type_check
def enter(
    start: int,
    grid: wp.array(dtype=wp.float32, ndim=3),
    origin: wp.vec3,
    voxel: float,
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
    last = wp.min(end, stop[i] + 4.0 * voxel)
    distance = begin
    previous = float(0.0)
    while distance < last:
        place = (centre + ray[i] * distance - origin) / voxel
        value = trilinear(grid, place)
        if value > 0.5:
            back = 0.5 * voxel * (value - 0.5) / wp.max(value - previous, 1.0e-3)
            entry[i] = distance - wp.min(back, 0.5 * voxel)
            gradient = wp.vec3(
                trilinear(grid, place + wp.vec3(1.5, 0.0, 0.0)) - trilinear(grid, place - wp.vec3(1.5, 0.0, 0.0)),
                trilinear(grid, place + wp.vec3(0.0, 1.5, 0.0)) - trilinear(grid, place - wp.vec3(0.0, 1.5, 0.0)),
                trilinear(grid, place + wp.vec3(0.0, 0.0, 1.5)) - trilinear(grid, place - wp.vec3(0.0, 0.0, 1.5)),
            )
            if wp.length(gradient) > 1.0e-4:
                outward = -wp.normalize(gradient)
                # A normal at grazing angles is a guess: it is turned towards the camera.
                normal[i] = wp.normalize(outward - ray[i] * 0.5)
            return
        previous = value
        distance += 0.5 * voxel


@wp.func
@no_type_check
def trilinear(grid: wp.array(dtype=wp.float32, ndim=3), place: wp.vec3) -> float:
    """Value at a place in voxels, nodes on the integers; zero outside."""
    x = int(wp.floor(place[0]))
    y = int(wp.floor(place[1]))
    z = int(wp.floor(place[2]))
    if x < 0 or y < 0 or z < 0 or x + 1 >= grid.shape[0] or y + 1 >= grid.shape[1] or z + 1 >= grid.shape[2]:
        return 0.0
    fx = place[0] - float(x)
    fy = place[1] - float(y)
    fz = place[2] - float(z)
    low = wp.lerp(
        wp.lerp(grid[x, y, z], grid[x + 1, y, z], fx), wp.lerp(grid[x, y + 1, z], grid[x + 1, y + 1, z], fx), fy
    )
    high = wp.lerp(
        wp.lerp(grid[x, y, z + 1], grid[x + 1, y, z + 1], fx),
        wp.lerp(grid[x, y + 1, z + 1], grid[x + 1, y + 1, z + 1], fx),
        fy,
    )
    return wp.lerp(low, high, fz)
