"""Warp kernels of what each pixel shows between lines (see `raster.openings`).

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.raster.kernels.keys import key_index
from neural_strands.raster.kernels.triangles import pixel_weights


@wp.kernel(enable_backward=False)
@no_type_check
def count_openings(
    start: int,
    depth: wp.array2d[float],
    segment: wp.array2d[wp.int64],
    width: int,
    factor: int,
    surface: wp.array[float],
    open_surface: wp.array[float],
    free: wp.array[float],
) -> None:
    """Shares of one pixel that are surface, open surface and open."""
    pixel = start + wp.tid()
    top = pixel // width * factor
    left = pixel % width * factor
    covered = wp.int32(0)
    bare = wp.int32(0)
    unhidden = wp.int32(0)
    for row in range(top, top + factor):
        for column in range(left, left + factor):
            is_surface = wp.where(depth[row, column] < wp.inf, 1, 0)
            is_open = wp.where(segment[row, column] < wp.int64(0), 1, 0)
            covered += is_surface
            unhidden += is_open
            bare += is_surface * is_open
    each = 1.0 / float(factor * factor)
    surface[pixel] = float(covered) * each
    open_surface[pixel] = float(bare) * each
    free[pixel] = float(unhidden) * each


@wp.func
@no_type_check
def texel_position(weights: wp.vec3, corner_uv: wp.array2d[wp.vec2], index: int, rows: int, columns: int) -> wp.vec2:
    """Column and row at which a texture is sampled; they are whole at the centres of texels."""
    uv = weights[0] * corner_uv[index, 0] + weights[1] * corner_uv[index, 1] + weights[2] * corner_uv[index, 2]
    x = wp.clamp(uv[0] * float(columns) - 0.5, 0.0, float(columns - 1))
    y = wp.clamp(uv[1] * float(rows) - 0.5, 0.0, float(rows - 1))
    return wp.vec2(x, y)


@wp.func
@no_type_check
def change_on(weights: wp.vec3, face: wp.vec3i, values: wp.array2d[float], channel: int) -> float:
    """One channel of values at vertices, interpolated on a face."""
    ends = wp.vec3(values[face[0], channel], values[face[1], channel], values[face[2], channel])
    return wp.dot(weights, ends)


@wp.kernel(enable_backward=False)
@no_type_check
def mean_colour(
    start: int,
    keys: wp.array2d[wp.int64],
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    corner_uv: wp.array2d[wp.vec2],
    changes: wp.array2d[float],
    width: int,
    factor: int,
    texture: wp.array2d[wp.vec3],
    colour: wp.array[wp.vec3],
) -> None:
    """Mean colour over the line pixels of one pixel that show the surface; the output holds zeros at the start."""
    pixel = start + wp.tid()
    top = pixel // width * factor
    left = pixel % width * factor
    total = wp.vec3(0.0, 0.0, 0.0)
    count = wp.float32(0.0)
    for row in range(top, top + factor):
        for column in range(left, left + factor):
            index = int(key_index(keys[row, column]))
            if index >= 0:
                face = faces[index]
                weights = pixel_weights(vertices[face[0]], vertices[face[1]], vertices[face[2]], row, column)
                at = texel_position(weights, corner_uv, index, texture.shape[0], texture.shape[1])
                x = int(at[0])
                y = int(at[1])
                right = wp.min(x + 1, texture.shape[1] - 1)
                below = wp.min(y + 1, texture.shape[0] - 1)
                across = at[0] - float(x)
                upper = wp.lerp(texture[y, x], texture[y, right], across)
                lower = wp.lerp(texture[below, x], texture[below, right], across)
                here = wp.lerp(upper, lower, at[1] - float(y))
                if changes.shape[0] > 0:
                    instead = wp.vec3(
                        change_on(weights, face, changes, 2),
                        change_on(weights, face, changes, 3),
                        change_on(weights, face, changes, 4),
                    )
                    here = wp.lerp(
                        change_on(weights, face, changes, 0) * here, instead, change_on(weights, face, changes, 1)
                    )
                total += here
                count += 1.0
    if count > 0.0:
        colour[pixel] = total / count


@wp.kernel(enable_backward=False)
@no_type_check
def scatter_to_texture(
    keys: wp.array2d[wp.int64],
    vertices: wp.array[wp.vec3],
    faces: wp.array[wp.vec3i],
    corner_uv: wp.array2d[wp.vec2],
    changes: wp.array2d[float],
    width: int,
    factor: int,
    grad_colour: wp.array[wp.vec3],
    grad_texture: wp.array2d[wp.vec3],
) -> None:
    """Add the gradient of one pixel's mean colour to the texture."""
    pixel = wp.tid()
    gradient = grad_colour[pixel]
    if wp.dot(gradient, gradient) == 0.0:
        return
    top = pixel // width * factor
    left = pixel % width * factor
    count = wp.float32(0.0)
    for row in range(top, top + factor):
        for column in range(left, left + factor):
            count += wp.where(key_index(keys[row, column]) < wp.int64(0), 0.0, 1.0)
    for row in range(top, top + factor):
        for column in range(left, left + factor):
            index = int(key_index(keys[row, column]))
            if index >= 0:
                face = faces[index]
                weights = pixel_weights(vertices[face[0]], vertices[face[1]], vertices[face[2]], row, column)
                at = texel_position(weights, corner_uv, index, grad_texture.shape[0], grad_texture.shape[1])
                share = 1.0 / count
                if changes.shape[0] > 0:
                    kept = 1.0 - change_on(weights, face, changes, 1)
                    share *= change_on(weights, face, changes, 0) * kept
                x = int(at[0])
                y = int(at[1])
                right = wp.min(x + 1, grad_texture.shape[1] - 1)
                below = wp.min(y + 1, grad_texture.shape[0] - 1)
                across = at[0] - float(x)
                lower = share * (at[1] - float(y))
                upper = share - lower
                wp.atomic_add(grad_texture, y, x, upper * (1.0 - across) * gradient)
                wp.atomic_add(grad_texture, y, right, upper * across * gradient)
                wp.atomic_add(grad_texture, below, x, lower * (1.0 - across) * gradient)
                wp.atomic_add(grad_texture, below, right, lower * across * gradient)
