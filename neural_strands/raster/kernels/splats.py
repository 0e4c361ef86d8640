"""Warp kernels of the bilinear splat at one resolution: sums in the forward pass, gathers in the backward pass.

Channels are grouped in fours, one vector instruction each: five times as fast on the CPU as channel by channel.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import Any, no_type_check

import warp as wp

ROW = 24
"""Channels of one vector that holds all channels of a point: those of a hair model by default, rounded up to fours."""
Row = wp.types.vector(length=ROW, dtype=wp.float32)


@wp.func
@no_type_check
def corner_weight(fraction: float, side: int) -> float:
    """Bilinear weight of the near (side 0) or far (side 1) neighbour along one axis."""
    if side == 0:
        return 1.0 - fraction
    return fraction


@wp.func_native("""
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    if (sizeof(value) == 4 * sizeof(float)) {
        float* place = &wp::index(sums, cell, group)[0];
        asm volatile("red.relaxed.gpu.global.add.v4.f32 [%0], {%1, %2, %3, %4};"
            :: "l"(place), "f"(value[0]), "f"(value[1]), "f"(value[2]), "f"(value[3]) : "memory");
        return;
    }
#endif
    wp::atomic_add(sums, cell, group, value);
""")
@no_type_check
def add_vector(sums: wp.array2d[Any], cell: int, group: int, value: Any) -> None:
    """Add some channels to a pixel's; since Hopper, GPUs add four in one instruction."""
    ...


@wp.func
@no_type_check
def add_to_neighbours(
    position: wp.vec2,
    amount: float,
    features: wp.array2d[Any],
    point: int,
    groups: wp.vec2i,
    width: int,
    rows: wp.vec2i,
    sums: wp.array2d[Any],
    weights: wp.array[float],
) -> None:
    """Add the vectors [groups[0], groups[1]) of a point to its four neighbours among the rows [rows[0], rows[1])."""
    x = position[0] - 0.5
    y = position[1] - 0.5
    if not (x > -1.0 and x < float(width) and y > float(rows[0]) - 1.0 and y < float(rows[1])):
        return
    column = int(wp.floor(x))
    row = int(wp.floor(y))
    for corner in range(4):
        u = column + corner % 2
        v = row + corner // 2
        weight = corner_weight(x - float(column), corner % 2) * corner_weight(y - float(row), corner // 2)
        weight *= amount
        if u >= 0 and u < width and v >= rows[0] and v < rows[1] and weight > 0.0:
            cell = v * width + u
            if groups[0] == 0:
                wp.atomic_add(weights, cell, weight)
            for group in range(groups[0], groups[1]):
                add_vector(sums, cell, group, weight * features[point, group])


@wp.kernel(enable_backward=False)
@no_type_check
def accumulate(
    pixels: wp.array[wp.vec2],
    amounts: wp.array[float],
    features: wp.array2d[wp.vec4],
    scale: float,
    width: int,
    first_row: int,
    last_row: int,
    quads_per_item: int,
    sums: wp.array2d[wp.vec4],
    weights: wp.array[float],
) -> None:
    """Add some groups of four channels of one point to its four neighbours among the rows [first_row, last_row)."""
    item = wp.tid()
    quads = features.shape[1]
    blocks = wp.max((quads + quads_per_item - 1) // quads_per_item, 1)
    point = item // blocks
    first = (item - point * blocks) * quads_per_item
    groups = wp.vec2i(first, wp.min(first + quads_per_item, quads))
    rows = wp.vec2i(first_row, last_row)
    add_to_neighbours(scale * pixels[point], amounts[point], features, point, groups, width, rows, sums, weights)


@wp.kernel(enable_backward=False)
@no_type_check
def accumulate_rows(
    pixels: wp.array[wp.vec2],
    amounts: wp.array[float],
    features: wp.array2d[Row],
    scale: float,
    width: int,
    first_row: int,
    last_row: int,
    sums: wp.array2d[Row],
    weights: wp.array[float],
) -> None:
    """`accumulate` with all channels of a point in one vector; for the CPU."""
    point = wp.tid()
    groups = wp.vec2i(0, 1)
    rows = wp.vec2i(first_row, last_row)
    add_to_neighbours(scale * pixels[point], amounts[point], features, point, groups, width, rows, sums, weights)


@wp.kernel(enable_backward=False)
@no_type_check
def normalise(start: int, minimum_weight: float, weights: wp.array[float], sums: wp.array2d[wp.vec4]) -> None:
    """Turn one pixel's sums into a weighted mean."""
    cell = start + wp.tid()
    if weights[cell] > 0.0:
        inverse = 1.0 / wp.max(weights[cell], minimum_weight)
        for quad in range(sums.shape[1]):
            sums[cell, quad] = sums[cell, quad] * inverse


@wp.kernel(enable_backward=False)
@no_type_check
def gather_gradients(
    start: int,
    pixels: wp.array[wp.vec2],
    amounts: wp.array[float],
    features: wp.array2d[wp.vec4],
    scale: float,
    width: int,
    height: int,
    minimum_weight: float,
    means: wp.array2d[wp.vec4],
    weights: wp.array[float],
    grad_means: wp.array2d[wp.vec4],
    grad_weights: wp.array[float],
    grad_pixels: wp.array[wp.vec2],
    grad_features: wp.array2d[wp.vec4],
) -> None:
    """Add the contributions of a point's four neighbours to the point's gradients."""
    point = start + wp.tid()
    x = pixels[point][0] * scale - 0.5
    y = pixels[point][1] * scale - 0.5
    if not (x > -1.0 and x < float(width) and y > -1.0 and y < float(height)):
        return
    column = int(wp.floor(x))
    row = int(wp.floor(y))
    total = wp.vec2(0.0, 0.0)
    for corner in range(4):
        u = column + corner % 2
        v = row + corner // 2
        weight_x = corner_weight(x - float(column), corner % 2)
        weight_y = corner_weight(y - float(row), corner // 2)
        if u >= 0 and u < width and v >= 0 and v < height:
            cell = v * width + u
            inverse = amounts[point] / wp.max(weights[cell], minimum_weight)
            # Below the smallest weight the divisor is constant, so the mean does not enter the derivative.
            kept = wp.float32(0.0)
            if weights[cell] > minimum_weight:
                kept = 1.0
            share = weight_x * weight_y * inverse
            pull = wp.float32(0.0)
            for quad in range(features.shape[1]):
                gradient = grad_means[cell, quad]
                pull += wp.dot(gradient, features[point, quad] - kept * means[cell, quad])
                grad_features[point, quad] = grad_features[point, quad] + share * gradient
            grad_weight = (pull * inverse + amounts[point] * grad_weights[cell]) * scale
            total += grad_weight * wp.vec2(
                float(2 * (corner % 2) - 1) * weight_y, float(2 * (corner // 2) - 1) * weight_x
            )
    grad_pixels[point] = grad_pixels[point] + total


@wp.kernel(enable_backward=False)
@no_type_check
def gather_feature_gradients(
    start: int,
    pixels: wp.array[wp.vec2],
    amounts: wp.array[float],
    scale: float,
    width: int,
    height: int,
    minimum_weight: float,
    quads_per_item: int,
    weights: wp.array[float],
    grad_means: wp.array2d[wp.vec4],
    grad_features: wp.array2d[wp.vec4],
) -> None:
    """`gather_gradients` for points whose positions need none; an item is some groups of four channels of a point."""
    item = start + wp.tid()
    blocks = grad_features.shape[1] // quads_per_item
    point = item // blocks
    first = (item - point * blocks) * quads_per_item
    x = pixels[point][0] * scale - 0.5
    y = pixels[point][1] * scale - 0.5
    if not (x > -1.0 and x < float(width) and y > -1.0 and y < float(height)):
        return
    column = int(wp.floor(x))
    row = int(wp.floor(y))
    for corner in range(4):
        u = column + corner % 2
        v = row + corner // 2
        weight_x = corner_weight(x - float(column), corner % 2)
        weight_y = corner_weight(y - float(row), corner // 2)
        if u >= 0 and u < width and v >= 0 and v < height:
            cell = v * width + u
            share = weight_x * weight_y * (amounts[point] / wp.max(weights[cell], minimum_weight))
            for quad in range(first, first + quads_per_item):
                grad_features[point, quad] = grad_features[point, quad] + share * grad_means[cell, quad]
