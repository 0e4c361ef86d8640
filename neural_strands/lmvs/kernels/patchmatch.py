"""Warp kernels of the line PatchMatch, for CPU and CUDA (see `lmvs.kernels.ribbons` for a line's cost)."""

# ruff: noqa: UP018  (to Warp, the cast makes a variable of a constant)
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.lmvs.kernels.ribbons import Patch, fetch, homogeneous, inside, line_cost

UNLIMITED = wp.constant(9.0)
"""A limit above every cost."""


@wp.func
@no_type_check
def seen_direction(
    texture: wp.array[wp.vec4],
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    point: wp.vec3,
    patch: Patch,
) -> wp.vec3:
    """Direction of the line through a point that agrees best with the orientations that the views see there.

    Each view's orientation confines the line to the plane through its centre and the line it sees: n . d = 0. With
    the reference's own n_0 exact, d = cos(t) a + sin(t) b in that plane, and the least squares over the neighbours,
    sum w (n_j . d)^2, is a 2 x 2 eigenvector.
    """
    image = homogeneous(projection, 0, point, 1.0)
    value = fetch(texture, 0, image[0] / image[2], image[1] / image[2], patch.width, patch.height)
    normal = seen_plane(value, image, plane, 0)
    ray = wp.normalize(point - centre[0])
    side = wp.normalize(wp.cross(normal, ray))
    xx = float(0.0)
    xy = float(0.0)
    yy = float(0.0)
    for j in range(1, patch.views + 1):
        seen = homogeneous(projection, j, point, 1.0)
        u = seen[0] / seen[2]
        v = seen[1] / seen[2]
        if inside(seen, patch):
            other = fetch(texture, j, u, v, patch.width, patch.height)
            plane_normal = seen_plane(other, seen, plane, j)
            weight = wp.length(wp.vec2(other[0], other[1]))
            x = wp.dot(plane_normal, side)
            y = wp.dot(plane_normal, ray)
            xx += weight * x * x
            xy += weight * x * y
            yy += weight * y * y
    # A small weight keeps the line perpendicular to the ray if no neighbour constrains it.
    yy += 0.02
    angle = 0.5 * wp.atan2(2.0 * xy, xx - yy) + 0.5 * wp.pi
    return wp.normalize(side * wp.cos(angle) + ray * wp.sin(angle))


@wp.func
@no_type_check
def seen_plane(value: wp.vec4, image: wp.vec3, plane: wp.array[wp.mat33], view: int) -> wp.vec3:
    """Unit world normal of the plane through the view's centre and the line it sees at a pixel.

    The normal of a homogeneous image line l is (K R)^T l; `plane` contains (K R)^T.
    """
    half = 0.5 * wp.atan2(value[1], value[0])
    x = wp.cos(half)
    y = wp.sin(half)
    u = image[0] / image[2]
    v = image[1] / image[2]
    return wp.normalize(plane[view] * wp.vec3(y, -x, x * v - y * u))


@wp.kernel(enable_backward=False)
@no_type_check
def sweep(
    start: int,
    ray: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    near: wp.array[float],
    far: wp.array[float],
    offset: wp.array[float],
    pixel_angle: float,
    texture: wp.array[wp.vec4],
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    patch: Patch,
    cost: wp.array(dtype=float, ndim=2),
) -> None:
    """Cost at each depth behind the hull, for the direction on which the views agree there; -1 beyond `far`."""
    i = start + wp.tid()
    for k in range(offset.shape[0]):
        distance = near[i] + offset[k]
        cost[i, k] = -1.0
        if distance < far[i]:
            point = centre[0] + ray[i] * distance
            line = seen_direction(texture, projection, centre, plane, point, patch)
            cost[i, k] = line_cost(
                texture, projection, point, line, normal[i], distance * pixel_angle, patch, UNLIMITED
            )


@wp.kernel(enable_backward=False)
@no_type_check
def look(
    start: int,
    ray: wp.array[wp.vec3],
    texture: wp.array[wp.vec4],
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    patch: Patch,
    depth: wp.array[float],
    direction: wp.array[wp.vec3],
) -> None:
    """Direction on which the views agree at each pixel's depth."""
    i = start + wp.tid()
    direction[i] = seen_direction(texture, projection, centre, plane, centre[0] + ray[i] * depth[i], patch)


@wp.kernel(enable_backward=False)
@no_type_check
def improve(
    start: int,
    colour: wp.array[int],
    adjacent: wp.array(dtype=wp.int32, ndim=2),
    ray: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    near: wp.array[float],
    far: wp.array[float],
    trials: int,
    depth_range: float,
    angle_range: float,
    seed: int,
    pixel_angle: float,
    texture: wp.array[wp.vec4],
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    patch: Patch,
    depth: wp.array[float],
    direction: wp.array[wp.vec3],
    cost: wp.array[float],
) -> None:
    """One half sweep: each pixel of a colour tries its neighbours' lines (of the other colour), then perturbs its own.

    A neighbour's line is moved to the pixel's ray: its point becomes the one closest to the ray, its direction stays.
    """
    i = colour[start + wp.tid()]
    best_cost = cost[i]
    best_depth = depth[i]
    best_line = direction[i]
    if best_cost > 2.0:
        best_cost = line_cost(
            texture,
            projection,
            centre[0] + ray[i] * best_depth,
            best_line,
            normal[i],
            best_depth * pixel_angle,
            patch,
            UNLIMITED,
        )
    for k in range(adjacent.shape[1]):
        other = adjacent[i, k]
        if other >= 0:
            line = direction[other]
            base = ray[other] * depth[other]
            along = wp.dot(line, ray[i])
            slack = 1.0 - along * along
            distance = wp.dot(base, ray[i] - line * along) / wp.max(slack, 1.0e-6)
            if slack > 0.03 and distance > near[i] and distance < far[i]:
                point = centre[0] + ray[i] * distance
                found = line_cost(texture, projection, point, line, normal[i], distance * pixel_angle, patch, best_cost)
                if found < best_cost:
                    best_cost = found
                    best_depth = distance
                    best_line = line
    state = wp.rand_init(seed, i)
    scale = float(1.0)
    for k in range(trials):
        distance = best_depth + depth_range * scale * (2.0 * wp.randf(state) - 1.0)
        line = wp.normalize(best_line + wp.sample_unit_sphere(state) * (angle_range * scale))
        if distance > near[i] and distance < far[i]:
            point = centre[0] + ray[i] * distance
            if k % 2 == 0:
                line = seen_direction(texture, projection, centre, plane, point, patch)
            found = line_cost(texture, projection, point, line, normal[i], distance * pixel_angle, patch, best_cost)
            if found < best_cost:
                best_cost = found
                best_depth = distance
                best_line = line
        scale *= 0.7
    cost[i] = best_cost
    depth[i] = best_depth
    direction[i] = best_line


@wp.kernel(enable_backward=False)
@no_type_check
def evaluate(
    start: int,
    point: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    footprint: wp.array[float],
    texture: wp.array[wp.vec4],
    projection: wp.array[wp.mat44],
    patch: Patch,
    limit: float,
    cost: wp.array[float],
) -> None:
    """Cost of given lines; incomplete as soon as it exceeds `limit`."""
    i = start + wp.tid()
    cost[i] = line_cost(texture, projection, point[i], direction[i], normal[i], footprint[i], patch, limit)
