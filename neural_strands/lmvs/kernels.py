"""Warp kernels of the line PatchMatch: one source for CPU and CUDA.

A view's texture holds, per pixel, the doubled orientation weighted by its confidence c (c cos 2a, c sin 2a), c, and the
brightness. View 0 is the reference, the others its neighbours. Pixel centres lie at +0.5.
"""

# ruff: noqa: UP018, RUF046  (Warp tells a variable from a constant by the cast)
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

NEIGHBOURS = wp.constant(8)
"""Most neighbour views of a reference view."""

Views = wp.types.vector(length=9, dtype=wp.float32)

MOST_SAMPLES = 128
"""Most samples of a ribbon."""

Samples = wp.types.vector(length=MOST_SAMPLES, dtype=wp.float32)


@wp.struct
@no_type_check
class Patch:
    """How a hypothesis is sampled and weighed.

    Attributes:
        along, across: samples to each side of the centre, along the line and across it.
        step: distance of samples in pixels of the reference.
        intensity: weight of 1 - NCC against the orientation's cost, in [0, 1].
        best: number of neighbours, the best ones, whose mean is the cost.
        views: number of neighbours.
        width, height: of the textures, pixels.
    """

    along: wp.int32
    across: wp.int32
    step: wp.float32
    intensity: wp.float32
    best: wp.int32
    views: wp.int32
    width: wp.int32
    height: wp.int32


@wp.func
@no_type_check
def fetch(texture: wp.array(dtype=wp.vec4, ndim=3), view: int, u: float, v: float, width: int, height: int) -> wp.vec4:
    """Bilinear sample at pixel coordinates (u, v); the caller keeps them inside."""
    x = wp.clamp(u - 0.5, 0.0, float(width) - 1.001)
    y = wp.clamp(v - 0.5, 0.0, float(height) - 1.001)
    column = int(x)
    row = int(y)
    fx = x - float(column)
    fy = y - float(row)
    top = texture[view, row, column] * (1.0 - fx) + texture[view, row, column + 1] * fx
    bottom = texture[view, row + 1, column] * (1.0 - fx) + texture[view, row + 1, column + 1] * fx
    return top * (1.0 - fy) + bottom * fy


@wp.func
@no_type_check
def homogeneous(projection: wp.array[wp.mat44], view: int, point: wp.vec3, weight: float) -> wp.vec3:
    """Homogeneous pixel of a point (weight 1) or a direction (weight 0)."""
    image = projection[view] * wp.vec4(point[0], point[1], point[2], weight)
    return wp.vec3(image[0], image[1], image[2])


@wp.func
@no_type_check
def doubled_angle(image: wp.vec3, motion: wp.vec3) -> wp.vec2:
    """Cosine and sine of twice the angle at which a line through `image` (homogeneous) with `motion` is seen."""
    x = motion[0] * image[2] - image[0] * motion[2]
    y = motion[1] * image[2] - image[1] * motion[2]
    square = wp.max(x * x + y * y, 1.0e-20)
    return wp.vec2((x * x - y * y) / square, 2.0 * x * y / square)


@wp.func
@no_type_check
def line_cost(
    texture: wp.array(dtype=wp.vec4, ndim=3),
    projection: wp.array[wp.mat44],
    point: wp.vec3,
    direction: wp.vec3,
    normal: wp.vec3,
    footprint: float,
    patch: Patch,
) -> float:
    """Cost in [0, 1] of a line through `point`; a ribbon about it is compared between the views.

    Geometric term: sin^2 of the angle between the projected line and the orientation seen at the samples, weighted by
    confidence. Intensity term: (1 - NCC) / 2 of the ribbon's brightness. Occluded neighbours drop out: the mean is over
    the best ones, and the reference's own geometric term counts beside it.
    """
    origin = homogeneous(projection, 0, point, 1.0)
    motion = homogeneous(projection, 0, direction, 0.0)
    # A line seen end-on would sample for ever: its steps are cut at twice the footprint.
    motion_u = motion[0] * origin[2] - origin[0] * motion[2]
    motion_v = motion[1] * origin[2] - origin[1] * motion[2]
    speed = wp.length(wp.vec2(motion_u, motion_v)) / (origin[2] * origin[2])
    step_along = patch.step * wp.min(1.0 / wp.max(speed, 1.0e-9), 2.0 * footprint)
    along = direction * step_along
    across = wp.normalize(wp.cross(normal, direction)) * (patch.step * footprint)
    reference = Samples()
    sum_r = float(0.0)
    sum_rr = float(0.0)
    own = float(0.0)
    own_weight = float(0.0)
    line = doubled_angle(origin, motion)
    run = homogeneous(projection, 0, along, 0.0)
    side = homogeneous(projection, 0, across, 0.0)
    index = int(0)
    for a in range(-patch.along, patch.along + 1):
        for b in range(-patch.across, patch.across + 1):
            image = origin + run * float(a) + side * float(b)
            value = fetch(texture, 0, image[0] / image[2], image[1] / image[2], patch.width, patch.height)
            own += 0.5 * (value[2] - value[0] * line[0] - value[1] * line[1])
            own_weight += value[2]
            reference[index] = value[3]
            sum_r += value[3]
            sum_rr += value[3] * value[3]
            index += 1
    count = float(index)
    variance_r = wp.max(sum_rr / count - sum_r * sum_r / (count * count), 1.0e-7)
    costs = Views()
    for j in range(1, patch.views + 1):
        costs[j] = 1.0
        origin = homogeneous(projection, j, point, 1.0)
        run = homogeneous(projection, j, along, 0.0)
        side = homogeneous(projection, j, across, 0.0)
        reach_a = float(patch.along)
        reach_b = float(patch.across)
        if (
            inside(origin + run * reach_a + side * reach_b, patch)
            and inside(origin - run * reach_a + side * reach_b, patch)
            and inside(origin + run * reach_a - side * reach_b, patch)
            and inside(origin - run * reach_a - side * reach_b, patch)
        ):
            line = doubled_angle(origin, run)
            sum_i = float(0.0)
            sum_ii = float(0.0)
            sum_ir = float(0.0)
            angle = float(0.0)
            angle_weight = float(0.0)
            index = int(0)
            for a in range(-patch.along, patch.along + 1):
                for b in range(-patch.across, patch.across + 1):
                    image = origin + run * float(a) + side * float(b)
                    value = fetch(texture, j, image[0] / image[2], image[1] / image[2], patch.width, patch.height)
                    angle += 0.5 * (value[2] - value[0] * line[0] - value[1] * line[1])
                    angle_weight += value[2]
                    sum_i += value[3]
                    sum_ii += value[3] * value[3]
                    sum_ir += value[3] * reference[index]
                    index += 1
            variance_i = wp.max(sum_ii / count - sum_i * sum_i / (count * count), 1.0e-7)
            ncc = (sum_ir / count - sum_i * sum_r / (count * count)) / wp.sqrt(variance_r * variance_i)
            geometric = float(0.5)
            if angle_weight > 1.0e-3 * count:
                geometric = angle / angle_weight
            costs[j] = (1.0 - patch.intensity) * geometric + patch.intensity * 0.5 * (1.0 - wp.clamp(ncc, -1.0, 1.0))
    total = float(0.0)
    for _k in range(patch.best):
        lowest = int(1)
        for j in range(2, patch.views + 1):
            if costs[j] < costs[lowest]:
                lowest = j
        total += wp.min(costs[lowest], 1.0)
        costs[lowest] = 3.0
    share = 1.0 - patch.intensity
    return (total + share * own / wp.max(own_weight, 1.0e-4)) / (float(patch.best) + share)


@wp.func
@no_type_check
def inside(image: wp.vec3, patch: Patch) -> bool:
    """Whether a homogeneous pixel lies in front of the camera and in the picture."""
    return (
        image[2] > 0.0
        and image[0] > 0.0
        and image[1] > 0.0
        and image[0] < float(patch.width) * image[2]
        and image[1] < float(patch.height) * image[2]
    )


@wp.func
@no_type_check
def seen_direction(
    texture: wp.array(dtype=wp.vec4, ndim=3),
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    point: wp.vec3,
    patch: Patch,
) -> wp.vec3:
    """Direction that the views agree on at a point, seen by the reference with its own orientation.

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
    # A little weight keeps the line across the ray where no neighbour says otherwise.
    yy += 0.02
    angle = 0.5 * wp.atan2(2.0 * xy, xx - yy) + 0.5 * wp.pi
    return wp.normalize(side * wp.cos(angle) + ray * wp.sin(angle))


@wp.func
@no_type_check
def seen_plane(value: wp.vec4, image: wp.vec3, plane: wp.array[wp.mat33], view: int) -> wp.vec3:
    """Unit world normal of the plane through the view's centre and the line it sees at a pixel.

    A line l of homogeneous pixels is seen from the plane with normal (K R)^T l; `plane` holds (K R)^T.
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
    texture: wp.array(dtype=wp.vec4, ndim=3),
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    patch: Patch,
    cost: wp.array(dtype=float, ndim=2),
) -> None:
    """Cost at each depth behind the hull's surface, the direction being what the views see there; -1 beyond `far`."""
    i = start + wp.tid()
    for k in range(offset.shape[0]):
        distance = near[i] + offset[k]
        cost[i, k] = -1.0
        if distance < far[i]:
            point = centre[0] + ray[i] * distance
            line = seen_direction(texture, projection, centre, plane, point, patch)
            cost[i, k] = line_cost(texture, projection, point, line, normal[i], distance * pixel_angle, patch)


@wp.kernel(enable_backward=False)
@no_type_check
def look(
    start: int,
    ray: wp.array[wp.vec3],
    texture: wp.array(dtype=wp.vec4, ndim=3),
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    patch: Patch,
    depth: wp.array[float],
    direction: wp.array[wp.vec3],
) -> None:
    """Direction that the views agree on at each pixel's depth."""
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
    texture: wp.array(dtype=wp.vec4, ndim=3),
    projection: wp.array[wp.mat44],
    centre: wp.array[wp.vec3],
    plane: wp.array[wp.mat33],
    patch: Patch,
    depth: wp.array[float],
    direction: wp.array[wp.vec3],
    cost: wp.array[float],
) -> None:
    """One half sweep: each pixel of a colour tries its neighbours' lines (of the other colour), then perturbs its own.

    A neighbour's line gives the point closest to my ray, its direction kept.
    """
    i = colour[start + wp.tid()]
    best_cost = cost[i]
    best_depth = depth[i]
    best_line = direction[i]
    if best_cost > 2.0:
        best_cost = line_cost(
            texture, projection, centre[0] + ray[i] * best_depth, best_line, normal[i], best_depth * pixel_angle, patch
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
                found = line_cost(
                    texture, projection, centre[0] + ray[i] * distance, line, normal[i], distance * pixel_angle, patch
                )
                if found < best_cost:
                    best_cost = found
                    best_depth = distance
                    best_line = line
    state = wp.rand_init(seed, i)
    scale = float(1.0)
    for k in range(trials):
        distance = best_depth + depth_range * scale * (2.0 * wp.randf(state) - 1.0)
        line = wp.normalize(best_line + wp.sample_unit_sphere(state) * (angle_range * scale))
        if k % 2 == 0:
            line = seen_direction(texture, projection, centre, plane, centre[0] + ray[i] * distance, patch)
        found = line_cost(
            texture, projection, centre[0] + ray[i] * distance, line, normal[i], distance * pixel_angle, patch
        )
        if found < best_cost and distance > near[i] and distance < far[i]:
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
    texture: wp.array(dtype=wp.vec4, ndim=3),
    projection: wp.array[wp.mat44],
    patch: Patch,
    cost: wp.array[float],
) -> None:
    """Cost of given lines."""
    i = start + wp.tid()
    cost[i] = line_cost(texture, projection, point[i], direction[i], normal[i], footprint[i], patch)
