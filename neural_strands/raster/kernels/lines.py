"""Warp kernels of the line rasteriser (see `lines` for the rule they follow).

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.raster.kernels.keys import key_depth, key_index, make_key

LONGEST = wp.constant(1.0e9)
"""Lines longer than this many pixels are not drawn, because float32 no longer resolves their position."""


@wp.func
@no_type_check
def transform(projection: wp.mat44, point: wp.vec3) -> wp.vec3:
    """World metres to homogeneous pixels (x * depth, y * depth, depth)."""
    moved = projection @ wp.vec4(point[0], point[1], point[2], 1.0)
    return wp.vec3(moved[0], moved[1], moved[2])


@wp.func
@no_type_check
def near_cut(depth_in: float, depth_out: float, near: float) -> float:
    """Fraction from one end to the other at which a segment crosses the near plane."""
    return (near - depth_in) / (depth_out - depth_in)


@wp.func
@no_type_check
def depth_at(fraction: float, inverse_a: float, inverse_b: float) -> float:
    """Depth at a fraction of the projected segment; the inverse of depth is linear on the screen."""
    return 1.0 / (inverse_a + fraction * (inverse_b - inverse_a))


@wp.func
@no_type_check
def draw_pixel(column: int, row: int, depth: float, index: int, width: int, keys: wp.array[wp.int64]) -> None:
    """Update one pixel's key, which keeps the nearest primitive."""
    wp.atomic_min(keys, row * width + column, make_key(depth, index))


@wp.func
@no_type_check
def draw_segment(a: wp.vec3, b: wp.vec3, index: int, width: int, height: int, keys: wp.array[wp.int64]) -> None:
    """Draw one segment whose ends (pixel x, pixel y, 1 / depth) lie in front of the camera."""
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    if wp.abs(dx) >= wp.abs(dy):
        if wp.abs(dx) < LONGEST:
            low = wp.max(wp.min(a[0], b[0]), 0.0)
            high = wp.min(wp.max(a[0], b[0]), float(width))
            start = int(wp.ceil(low - 0.5))
            stop = int(wp.ceil(high - 0.5))
            for column in range(start, stop):
                fraction = (float(column) + 0.5 - a[0]) / dx
                y = a[1] + fraction * dy
                if y >= 0.0 and y < float(height):
                    draw_pixel(column, int(y), depth_at(fraction, a[2], b[2]), index, width, keys)
    elif wp.abs(dy) < LONGEST:
        low = wp.max(wp.min(a[1], b[1]), 0.0)
        high = wp.min(wp.max(a[1], b[1]), float(height))
        start = int(wp.ceil(low - 0.5))
        stop = int(wp.ceil(high - 0.5))
        for row in range(start, stop):
            fraction = (float(row) + 0.5 - a[1]) / dy
            x = a[0] + fraction * dx
            if x >= 0.0 and x < float(width):
                draw_pixel(int(x), row, depth_at(fraction, a[2], b[2]), index, width, keys)


@wp.func
@no_type_check
def draw_wide_segment(
    a: wp.vec3,
    b: wp.vec3,
    half_a: float,
    half_b: float,
    index: int,
    width: int,
    height: int,
    keys: wp.array[wp.int64],
) -> None:
    """Draw one segment like `draw_segment`, but with all pixels across it whose centres lie within its width.

    Args:
        a: one end in front of the camera (pixel x, pixel y, 1 / depth).
        b: the other end.
        half_a: half the width at `a`, pixels.
        half_b: half the width at `b`, pixels.
        index: global segment index.
        width: width of the image, pixels.
        height: height of the image, pixels.
        keys: of all pixels.
    """
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    if wp.abs(dx) >= wp.abs(dy):
        if wp.abs(dx) < LONGEST:
            low = wp.max(wp.min(a[0], b[0]), 0.0)
            high = wp.min(wp.max(a[0], b[0]), float(width))
            # Along a column, an inclined line is wider than perpendicular to itself.
            stretch = wp.sqrt(1.0 + dy * dy / (dx * dx))
            for column in range(int(wp.ceil(low - 0.5)), int(wp.ceil(high - 0.5))):
                fraction = (float(column) + 0.5 - a[0]) / dx
                y = a[1] + fraction * dy
                half = (half_a + fraction * (half_b - half_a)) * stretch
                depth = depth_at(fraction, a[2], b[2])
                top = int(wp.ceil(wp.max(y - half, 0.0) - 0.5))
                for row in range(top, int(wp.ceil(wp.min(y + half, float(height)) - 0.5))):
                    draw_pixel(column, row, depth, index, width, keys)
    elif wp.abs(dy) < LONGEST:
        low = wp.max(wp.min(a[1], b[1]), 0.0)
        high = wp.min(wp.max(a[1], b[1]), float(height))
        stretch = wp.sqrt(1.0 + dx * dx / (dy * dy))
        for row in range(int(wp.ceil(low - 0.5)), int(wp.ceil(high - 0.5))):
            fraction = (float(row) + 0.5 - a[1]) / dy
            x = a[0] + fraction * dx
            half = (half_a + fraction * (half_b - half_a)) * stretch
            depth = depth_at(fraction, a[2], b[2])
            left = int(wp.ceil(wp.max(x - half, 0.0) - 0.5))
            for column in range(left, int(wp.ceil(wp.min(x + half, float(width)) - 0.5))):
                draw_pixel(column, row, depth, index, width, keys)


@wp.func
@no_type_check
def focal_length(projection: wp.mat44) -> float:
    """Pixels per metre at a depth of one metre: the mean of both axes, independent of the principal point."""
    across = wp.vec3(projection[0, 0], projection[0, 1], projection[0, 2])
    down = wp.vec3(projection[1, 0], projection[1, 1], projection[1, 2])
    ahead = wp.vec3(projection[2, 0], projection[2, 1], projection[2, 2])
    return wp.sqrt(wp.length(wp.cross(across, ahead)) * wp.length(wp.cross(down, ahead)))


@wp.func
@no_type_check
def tapered(tip: float, along: float) -> float:
    """Remaining share of a strand's width (`LineConfig.tip`) where its parameter, 0 at the root, is `along`."""
    if tip <= 0.0:
        return 1.0
    return wp.min((1.0 - along) / tip, 1.0)


@wp.func
@no_type_check
def parameter_at(parameters: wp.array[float], strand: int, k: int, points_per_strand: int) -> float:
    """Parameter t of a strand's k-th point: the stored one, or evenly spaced where none are stored."""
    if parameters.shape[0] > 0:
        return parameters[strand * points_per_strand + k]
    return float(k) / float(points_per_strand - 1)


@wp.func
@no_type_check
def end_radii(
    radius: float, tip: float, parameters: wp.array[float], strand: int, k: int, points_per_strand: int
) -> wp.vec2:
    """Half the width at both ends of a strand's k-th segment, where `radius` is that of the strand."""
    return wp.vec2(
        radius * tapered(tip, parameter_at(parameters, strand, k, points_per_strand)),
        radius * tapered(tip, parameter_at(parameters, strand, k + 1, points_per_strand)),
    )


@wp.func
@no_type_check
def to_screen(point: wp.vec3) -> wp.vec3:
    """Homogeneous pixels to pixel x, pixel y and inverse depth."""
    inverse = 1.0 / point[2]
    return wp.vec3(point[0] * inverse, point[1] * inverse, inverse)


@wp.func
@no_type_check
def draw_in_front(
    a: wp.vec3,
    b: wp.vec3,
    a_screen: wp.vec3,
    b_screen: wp.vec3,
    near: float,
    radii: wp.vec2,
    index: int,
    size: wp.vec2i,
    keys: wp.array[wp.int64],
) -> None:
    """Draw the part of one segment that lies in front of the near plane.

    Args:
        a: one end in homogeneous pixels.
        b: the other end.
        a_screen: `a` as `to_screen` gives it.
        b_screen: `b` as `to_screen` gives it.
        near: depth of the near plane, metres.
        radii: half the width at both ends, pixels at one metre's depth; zeros for a line one pixel wide.
        index: global segment index.
        size: width and height of the image, pixels.
        keys: of all pixels.
    """
    if not (a[2] > near or b[2] > near):
        return
    first = a_screen
    second = b_screen
    if not b[2] > near:
        second = to_screen(wp.lerp(a, b, near_cut(a[2], b[2], near)))
    if not a[2] > near:
        first = to_screen(wp.lerp(b, a, near_cut(b[2], a[2], near)))
    if radii[0] > 0.0 or radii[1] > 0.0:
        draw_wide_segment(first, second, radii[0] * first[2], radii[1] * second[2], index, size[0], size[1], keys)
    else:
        draw_segment(first, second, index, size[0], size[1], keys)


@wp.kernel(enable_backward=False)
@no_type_check
def draw_lines(
    first: int,
    points: wp.array[wp.vec3],
    projections: wp.array[wp.mat44],
    near: float,
    strand_width: float,
    tip: float,
    parameters: wp.array[float],
    points_per_strand: int,
    runs_per_strand: int,
    segments_per_run: int,
    width: int,
    height: int,
    keys: wp.array[wp.int64],
) -> None:
    """Draw one run of consecutive segments of one strand; neighbouring segments share a projected point."""
    item = first + wp.tid()
    projection = projections[0]
    strand = item // runs_per_strand
    start = (item - strand * runs_per_strand) * segments_per_run
    stop = wp.min(start + segments_per_run, points_per_strand - 1)
    base = strand * points_per_strand
    a = transform(projection, points[base + start])
    a_screen = to_screen(a)
    radius = 0.5 * strand_width * focal_length(projection)
    for k in range(start, stop):
        b = transform(projection, points[base + k + 1])
        b_screen = to_screen(b)
        index = strand * (points_per_strand - 1) + k
        radii = end_radii(radius, tip, parameters, strand, k, points_per_strand)
        # A strand whose width has tapered to zero is not drawn; a configured width of zero means one pixel.
        if radius <= 0.0 or radii[0] > 0.0 or radii[1] > 0.0:
            draw_in_front(a, b, a_screen, b_screen, near, radii, index, wp.vec2i(width, height), keys)
        a = b
        a_screen = b_screen


@wp.kernel(enable_backward=False)
@no_type_check
def resolve_lines(
    first: int,
    keys: wp.array2d[wp.int64],
    points: wp.array[wp.vec3],
    projections: wp.array[wp.mat44],
    near: float,
    points_per_strand: int,
    width: int,
    segment: wp.array[wp.int64],
    position: wp.array[float],
    depth: wp.array[float],
) -> None:
    """Recover a pixel's segment, depth and perspective-correct position from the smallest of its keys in all planes."""
    pixel = first + wp.tid()
    key = keys[0, pixel]
    for plane in range(1, keys.shape[0]):
        key = wp.min(key, keys[plane, pixel])
    index = key_index(key)
    segment[pixel] = index
    if index < wp.int64(0):
        position[pixel] = 0.0
        depth[pixel] = wp.inf
        return
    strand = int(index) // (points_per_strand - 1)
    base = int(index) + strand
    a = transform(projections[0], points[base])
    b = transform(projections[0], points[base + 1])
    # The part of the segment in front of the near plane runs from `begin` to `end` of its length.
    begin = wp.float32(0.0)
    end = wp.float32(1.0)
    if not a[2] > near:
        begin = 1.0 - near_cut(b[2], a[2], near)
    if not b[2] > near:
        end = near_cut(a[2], b[2], near)
    a_screen = to_screen(wp.lerp(a, b, begin))
    b_screen = to_screen(wp.lerp(a, b, end))
    dx = b_screen[0] - a_screen[0]
    dy = b_screen[1] - a_screen[1]
    row = pixel // width
    if wp.abs(dx) >= wp.abs(dy):
        fraction = (float(pixel - row * width) + 0.5 - a_screen[0]) / dx
    else:
        fraction = (float(row) + 0.5 - a_screen[1]) / dy
    inverse = a_screen[2] + fraction * (b_screen[2] - a_screen[2])
    along = fraction * b_screen[2] / inverse
    position[pixel] = wp.clamp(begin + along * (end - begin), 0.0, 1.0)
    depth[pixel] = key_depth(key)
