"""Cost of a PatchMatch hypothesis: a ribbon around a 3D line, compared between the views.

A view's texture holds, per pixel, the doubled orientation weighted by its confidence c (c cos 2a, c sin 2a), c, and the
brightness; the textures of all views lie one after the other, row by row. View 0 is the reference, the others its
neighbours. Pixel centres lie at +0.5.

Nearly all of the stereo's time is spent here. On the CPU the samples of a view go through two loops: one over their
positions, without branches, which the compiler turns into vector instructions, and one over the values read there.
"""

# ruff: noqa: UP018  (to Warp, the cast makes a variable of a constant)
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

MOST_NEIGHBOURS = 8
"""Largest number of neighbour views of a reference."""

MOST_SAMPLES = 128
"""Largest number of samples of a ribbon; a multiple of eight, because they are processed in vectors of eight."""

Costs = wp.types.vector(length=MOST_NEIGHBOURS, dtype=wp.float32)
Samples = wp.types.vector(length=MOST_SAMPLES, dtype=wp.float32)
Places = wp.types.vector(length=MOST_SAMPLES, dtype=wp.int32)


@wp.struct
@no_type_check
class Patch:
    """Sampling and weights of a hypothesis.

    Attributes:
        along, across: samples to each side of the centre, along the line and across it.
        step: distance of samples in pixels of the reference.
        intensity: weight of 1 - NCC against the orientation's cost, in [0, 1].
        best: number of best neighbours whose mean is the cost.
        views: number of neighbours.
        width, height: size of the textures, pixels.
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
def blend(texture: wp.array[wp.vec4], first: int, width: int, fx: float, fy: float) -> wp.vec4:
    """Interpolate between the pixel `first`, the next in its row, and the two below them."""
    fxy = fx * fy
    return (
        texture[first] * (1.0 - fx - fy + fxy)
        + texture[first + 1] * (fx - fxy)
        + texture[first + width] * (fy - fxy)
        + texture[first + width + 1] * fxy
    )


@wp.func
@no_type_check
def fetch(texture: wp.array[wp.vec4], view: int, u: float, v: float, width: int, height: int) -> wp.vec4:
    """Bilinear sample at pixel coordinates (u, v), clamped to the border."""
    x = wp.clamp(u - 0.5, 0.0, float(width) - 1.001)
    y = wp.clamp(v - 0.5, 0.0, float(height) - 1.001)
    column = int(x)
    row = int(y)
    first = (view * height + row) * width + column
    return blend(texture, first, width, x - float(column), y - float(row))


@wp.func
@no_type_check
def homogeneous(projection: wp.array[wp.mat44], view: int, point: wp.vec3, weight: float) -> wp.vec3:
    """Homogeneous pixel of a point (weight 1) or a direction (weight 0)."""
    image = projection[view] * wp.vec4(point[0], point[1], point[2], weight)
    return wp.vec3(image[0], image[1], image[2])


@wp.func
@no_type_check
def seen_motion(image: wp.vec3, motion: wp.vec3) -> wp.vec2:
    """Motion in pixels, times squared depth, of a homogeneous pixel for a step whose projection is `motion`."""
    return wp.vec2(motion[0] * image[2] - image[0] * motion[2], motion[1] * image[2] - image[1] * motion[2])


@wp.func
@no_type_check
def doubled_angle(image: wp.vec3, motion: wp.vec3) -> wp.vec2:
    """Cosine and sine of twice the image angle of a line through `image` (homogeneous) with direction `motion`."""
    seen = seen_motion(image, motion)
    square = wp.max(wp.dot(seen, seen), 1.0e-20)
    return wp.vec2((seen[0] * seen[0] - seen[1] * seen[1]) / square, 2.0 * seen[0] * seen[1] / square)


@wp.func
@no_type_check
def inside(image: wp.vec3, patch: Patch) -> bool:
    """Whether a homogeneous pixel lies in front of the camera and inside the image."""
    return (
        image[2] > 0.0
        and image[0] > 0.0
        and image[1] > 0.0
        and image[0] < float(patch.width) * image[2]
        and image[1] < float(patch.height) * image[2]
    )


@wp.func
@no_type_check
def metres_a_pixel(image: wp.vec3, motion: wp.vec3, footprint: float) -> float:
    """Length of a line within a pixel, metres; at most twice the footprint, even for a line seen end-on."""
    speed = wp.length(seen_motion(image, motion)) / (image[2] * image[2])
    return wp.min(1.0 / wp.max(speed, 1.0e-9), 2.0 * footprint)


@wp.func
@no_type_check
def variance(total: float, squares: float, count: float) -> float:
    """Variance from the sums of values and of their squares, at least that of noise."""
    return wp.max(squares / count - total * total / (count * count), 1.0e-7)


@wp.func
@no_type_check
def line_cost(
    texture: wp.array[wp.vec4],
    projection: wp.array[wp.mat44],
    point: wp.vec3,
    direction: wp.vec3,
    normal: wp.vec3,
    footprint: float,
    patch: Patch,
    limit: float,
) -> float:
    """Cost in [0, 1] of a line through `point`; a ribbon around it is compared between the views.

    Geometric term: sin^2 of the angle between the projected line and the orientation seen at the samples, weighted by
    confidence. Intensity term: (1 - NCC) / 2 of the ribbon's brightness. The mean is over the best neighbours, so that
    occluded ones drop out, and the reference's own geometric term is added. As soon as the views so far exceed `limit`,
    whatever the others contribute, their cost is returned.
    """
    origin = homogeneous(projection, 0, point, 1.0)
    motion = homogeneous(projection, 0, direction, 0.0)
    along = direction * (patch.step * metres_a_pixel(origin, motion, footprint))
    across = wp.normalize(wp.cross(normal, direction)) * (patch.step * footprint)
    wide = float(2 * patch.across + 1)
    samples = (2 * patch.across + 1) * (2 * patch.along + 1)
    padded = (samples + 7) // 8 * 8
    count = float(samples)
    width = float(patch.width)
    height = float(patch.height)
    share = 1.0 - patch.intensity
    weight = 1.0 / (float(patch.best) + share)
    reference = Samples()
    right = Samples()
    down = Samples()
    places = Places()
    worst = Costs()
    variance_r = float(1.0)
    sum_r = float(0.0)
    total = float(0.0)
    j = wp.int32(0)
    while j <= patch.views:
        origin = homogeneous(projection, j, point, 1.0)
        run = homogeneous(projection, j, along, 0.0)
        side = homogeneous(projection, j, across, 0.0)
        outside = wp.int32(0)
        s = wp.int32(0)
        while s < padded:
            a = float(int((float(s) + 0.5) / wide))
            b = float(s) - a * wide - float(patch.across)
            a -= float(patch.along)
            depth = origin[2] + run[2] * a + side[2] * b
            u = (origin[0] + run[0] * a + side[0] * b) / depth
            v = (origin[1] + run[1] * a + side[1] * b) / depth
            seen = depth > 0.0 and u > 0.0 and v > 0.0 and u < width and v < height
            outside += wp.where(s < samples and not seen, 1, 0)
            x = wp.min(wp.max(u - 0.5, 0.0), width - 1.001)
            y = wp.min(wp.max(v - 0.5, 0.0), height - 1.001)
            right[s] = x - float(int(x))
            down[s] = y - float(int(y))
            places[s] = (j * patch.height + int(y)) * patch.width + int(x)
            s += 1
        found = float(1.0)
        if j == 0 or outside == 0:
            line = doubled_angle(origin, run)
            sums = wp.vec4()
            squares = float(0.0)
            products = float(0.0)
            s = wp.int32(0)
            while s < samples:
                # The maximum tells the compiler that no index is negative: Warp counts negative ones from the array's
                # end.
                value = blend(texture, wp.max(places[s], 0), patch.width, right[s], down[s])
                sums += value
                squares += value[3] * value[3]
                products += value[3] * reference[s]
                reference[s] = wp.where(j == 0, value[3], reference[s])
                s += 1
            angle = 0.5 * (sums[2] - sums[0] * line[0] - sums[1] * line[1])
            variance_j = variance(sums[3], squares, count)
            if j == 0:
                total = share * angle / wp.max(sums[2], 1.0e-4)
                sum_r = sums[3]
                variance_r = variance_j
            else:
                covariance = products / count - sums[3] * sum_r / (count * count)
                ncc = wp.clamp(covariance / wp.sqrt(variance_r * variance_j), -1.0, 1.0)
                geometric = wp.where(sums[2] > 1.0e-3 * count, angle / sums[2], 0.5)
                found = share * geometric + patch.intensity * 0.5 * (1.0 - ncc)
        if j > 0:
            # The worst costs so far are set aside and finally dropped, so the sum of the others only grows.
            k = wp.int32(0)
            while k < patch.views - patch.best:
                kept = wp.max(worst[k], found)
                found = wp.min(worst[k], found)
                worst[k] = kept
                k += 1
            total += found
            if total * weight > limit:
                return total * weight
        j += 1
    return total * weight
