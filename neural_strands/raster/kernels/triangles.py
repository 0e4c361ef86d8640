"""Warp kernels of the triangle rasteriser (see `triangles` for the rule they follow).

All but the first take vertices in homogeneous pixels.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.raster.kernels.keys import NOT_DRAWN, key_depth, key_index, key_of_bits, make_key

TOLERANCE = wp.constant(1.0e-6)
"""Barycentric distance outside a triangle up to which a pixel still counts, so that rounding leaves no cracks."""
LANES = wp.constant(16)
"""Neighbouring pixels that the CPU tests together."""


@wp.kernel(enable_backward=False)
@no_type_check
def project_vertices(
    first: int, vertices: wp.array[wp.vec3], projections: wp.array[wp.mat44], projected: wp.array[wp.vec3]
) -> None:
    """One vertex in homogeneous pixels (x * depth, y * depth, depth)."""
    vertex = first + wp.tid()
    point = vertices[vertex]
    moved = projections[0] @ wp.vec4(point[0], point[1], point[2], 1.0)
    projected[vertex] = wp.vec3(moved[0], moved[1], moved[2])


@wp.func
@no_type_check
def grow(box: wp.vec4, point: wp.vec3) -> wp.vec4:
    """Extend a box (least x, least y, greatest x, greatest y) to the projection of a point."""
    x = point[0] / point[2]
    y = point[1] / point[2]
    return wp.vec4(wp.min(box[0], x), wp.min(box[1], y), wp.max(box[2], x), wp.max(box[3], y))


@wp.func
@no_type_check
def grow_edge(box: wp.vec4, a: wp.vec3, b: wp.vec3, near: float) -> wp.vec4:
    """Extend a box to the first end of an edge and to the point where the edge crosses the near plane."""
    grown = box
    if a[2] > near:
        grown = grow(grown, a)
    if (a[2] > near) != (b[2] > near):
        grown = grow(grown, wp.lerp(a, b, (near - a[2]) / (b[2] - a[2])))
    return grown


@wp.func
@no_type_check
def pixel_box(a: wp.vec3, b: wp.vec3, c: wp.vec3, near: float, width: int, first_row: int, last_row: int) -> wp.vec4i:
    """Columns [0, 1) and rows [2, 3) that a face may cover; none if a corner is not finite."""
    box = wp.vec4(float(width), float(last_row), 0.0, float(first_row))
    box = grow_edge(box, a, b, near)
    box = grow_edge(box, b, c, near)
    box = grow_edge(box, c, a, near)
    if not wp.isfinite(box[0] + box[1] + box[2] + box[3] + a[2] + b[2] + c[2]):
        return wp.vec4i(0, 0, 0, 0)
    left = int(wp.ceil(wp.clamp(box[0], 0.0, float(width)) - 0.501))
    right = int(wp.floor(wp.clamp(box[2], 0.0, float(width)) + 0.501))
    top = int(wp.ceil(wp.clamp(box[1], float(first_row), float(last_row)) - 0.501))
    bottom = int(wp.floor(wp.clamp(box[3], float(first_row), float(last_row)) + 0.501))
    return wp.vec4i(wp.max(left, 0), wp.min(right, width), wp.max(top, first_row), wp.min(bottom, last_row))


@wp.func
@no_type_check
def cross_2d(a: wp.vec3, b: wp.vec3) -> float:
    """Cross product of the first two components."""
    return a[0] * b[1] - a[1] * b[0]


@wp.func
@no_type_check
def weights_at(a: wp.vec3, b: wp.vec3, c: wp.vec3, x: float, y: float) -> wp.vec3:
    """Barycentric coordinates of a pixel up to a common factor (zero edge-on), from corners in homogeneous pixels.

    The pixel is moved to the origin first, which keeps float32 accurate enough near silhouettes.
    """
    a_moved = wp.vec3(a[0] - x * a[2], a[1] - y * a[2], 0.0)
    b_moved = wp.vec3(b[0] - x * b[2], b[1] - y * b[2], 0.0)
    c_moved = wp.vec3(c[0] - x * c[2], c[1] - y * c[2], 0.0)
    return wp.vec3(cross_2d(b_moved, c_moved), cross_2d(c_moved, a_moved), cross_2d(a_moved, b_moved))


@wp.kernel(enable_backward=False)
@no_type_check
def draw_triangles(
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    near: float,
    width: int,
    first_row: int,
    last_row: int,
    stripes: int,
    keys: wp.array[wp.int64],
) -> None:
    """Draw every `stripes`-th row of one face among the rows [first_row, last_row); for CUDA."""
    item = wp.tid()
    face = item // stripes
    a = vertices[faces[face][0]]
    b = vertices[faces[face][1]]
    c = vertices[faces[face][2]]
    box = pixel_box(a, b, c, near, width, first_row, last_row)
    for row in range(box[2] + item - face * stripes, box[3], stripes):
        for column in range(box[0], box[1]):
            weights = weights_at(a, b, c, float(column) + 0.5, float(row) + 0.5)
            total = weights[0] + weights[1] + weights[2]
            if total < 0.0:
                weights = -weights
                total = -total
            if total > 0.0 and wp.min(wp.min(weights[0], weights[1]), weights[2]) >= -TOLERANCE * total:
                depth = (weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2]) / total
                if depth > near:
                    key = make_key(depth, face)
                    pixel = row * width + column
                    if key < keys[pixel]:
                        wp.atomic_min(keys, pixel, key)


@wp.kernel(enable_backward=False)
@no_type_check
def draw_triangles_in_lanes(
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    near: float,
    width: int,
    first_row: int,
    last_row: int,
    keys: wp.array[wp.int64],
) -> None:
    """Draw one face among the rows [first_row, last_row) as `draw_triangles` does; for the CPU.

    Neighbouring pixels are tested together, without branches, in a loop that the compiler vectorises.
    """
    face = wp.tid()
    a = vertices[faces[face][0]]
    b = vertices[faces[face][1]]
    c = vertices[faces[face][2]]
    box = pixel_box(a, b, c, near, width, first_row, last_row)
    depths = wp.zeros(shape=(LANES,), dtype=int)
    for row in range(box[2], box[3]):
        for column in range(box[0], box[1], LANES):
            k = wp.int32(0)
            while k < LANES:
                weights = weights_at(a, b, c, float(column + k) + 0.5, float(row) + 0.5)
                signed = weights[0] + weights[1] + weights[2]
                sign = wp.where(signed < 0.0, -1.0, 1.0)
                u = sign * weights[0]
                v = sign * weights[1]
                w = sign * weights[2]
                total = sign * signed
                depth = (u * a[2] + v * b[2] + w * c[2]) / total
                inside = total > 0.0 and wp.min(wp.min(u, v), w) >= -TOLERANCE * total and depth > near
                depths[k] = wp.where(inside, wp.cast(depth, wp.int32), NOT_DRAWN)
                k += 1
            count = wp.min(LANES, box[1] - column)
            k = wp.int32(0)
            while k < count:
                if depths[k] < NOT_DRAWN:
                    wp.atomic_min(keys, row * width + column + k, key_of_bits(depths[k], face))
                k += 1


@wp.kernel(enable_backward=False)
@no_type_check
def resolve_depths(first: int, keys: wp.array[wp.int64], depth: wp.array[float]) -> None:
    """The depth of a pixel's key, which is infinite where nothing has been drawn."""
    pixel = first + wp.tid()
    depth[pixel] = key_depth(keys[pixel])


@wp.func
@no_type_check
def pixel_weights(a: wp.vec3, b: wp.vec3, c: wp.vec3, row: int, column: int) -> wp.vec3:
    """Barycentric coordinates of a pixel's centre, from corners in homogeneous pixels; never negative."""
    weights = weights_at(a, b, c, float(column) + 0.5, float(row) + 0.5)
    weights = weights / (weights[0] + weights[1] + weights[2])
    weights = wp.max(weights, wp.vec3(0.0, 0.0, 0.0))
    return weights / (weights[0] + weights[1] + weights[2])


@wp.kernel(enable_backward=False)
@no_type_check
def resolve_weights(
    first: int,
    keys: wp.array[wp.int64],
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    width: int,
    barycentric: wp.array[wp.vec3],
) -> None:
    """Recover a pixel's barycentric coordinates from its key; the output holds zeros at the start."""
    pixel = first + wp.tid()
    index = int(key_index(keys[pixel]))
    if index >= 0:
        a = vertices[faces[index][0]]
        b = vertices[faces[index][1]]
        c = vertices[faces[index][2]]
        row = pixel // width
        barycentric[pixel] = pixel_weights(a, b, c, row, pixel - row * width)
