"""Warp kernels that interpolate a grid of samples (see `geometry.voxel_grid`).

A place is a position relative to the first node, in multiples of the spacing.
"""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.func
@no_type_check
def last_node(shape: wp.vec3i) -> wp.vec3:
    """Place of the node opposite the first."""
    return wp.vec3(float(shape[0] - 1), float(shape[1] - 1), float(shape[2] - 1))


@wp.func
@no_type_check
def within(place: wp.vec3, shape: wp.vec3i) -> bool:
    """Whether a place lies between the outermost nodes."""
    last = last_node(shape)
    return (
        place[0] >= 0.0
        and place[1] >= 0.0
        and place[2] >= 0.0
        and place[0] <= last[0]
        and place[1] <= last[1]
        and place[2] <= last[2]
    )


@wp.struct
@no_type_check
class Cell:
    """The cell of eight nodes around a place.

    Attributes:
        corner: the lowest of its nodes.
        ahead: offset of the place from that node.
    """

    corner: wp.vec3i
    ahead: wp.vec3


@wp.func
@no_type_check
def cell_about(place: wp.vec3, shape: wp.vec3i) -> Cell:
    """The cell of a place between the outermost nodes; an arbitrary cell if it is not finite."""
    cell = Cell()
    cell.corner = wp.vec3i(
        wp.clamp(int(place[0]), 0, shape[0] - 2),
        wp.clamp(int(place[1]), 0, shape[1] - 2),
        wp.clamp(int(place[2]), 0, shape[2] - 2),
    )
    cell.ahead = place - wp.vec3(float(cell.corner[0]), float(cell.corner[1]), float(cell.corner[2]))
    return cell


@wp.func
@no_type_check
def nearest_place(place: wp.vec3, shape: wp.vec3i) -> wp.vec3:
    """Clamp a place to the outermost nodes."""
    return wp.min(wp.max(place, wp.vec3(0.0)), last_node(shape))


@wp.func
@no_type_check
def blend(values: wp.array3d[float], cell: Cell) -> float:
    """Trilinear interpolation of the nodes of a cell."""
    x = cell.corner[0]
    y = cell.corner[1]
    z = cell.corner[2]
    ahead = cell.ahead
    a00 = wp.lerp(values[x, y, z], values[x, y, z + 1], ahead[2])
    a01 = wp.lerp(values[x, y + 1, z], values[x, y + 1, z + 1], ahead[2])
    a10 = wp.lerp(values[x + 1, y, z], values[x + 1, y, z + 1], ahead[2])
    a11 = wp.lerp(values[x + 1, y + 1, z], values[x + 1, y + 1, z + 1], ahead[2])
    return wp.lerp(wp.lerp(a00, a01, ahead[1]), wp.lerp(a10, a11, ahead[1]), ahead[0])


@wp.func
@no_type_check
def slope(values: wp.array3d[float], cell: Cell) -> wp.vec3:
    """Gradient of that interpolation, per spacing."""
    x = cell.corner[0]
    y = cell.corner[1]
    z = cell.corner[2]
    ahead = cell.ahead
    a00 = wp.lerp(values[x, y, z], values[x, y, z + 1], ahead[2])
    a01 = wp.lerp(values[x, y + 1, z], values[x, y + 1, z + 1], ahead[2])
    a10 = wp.lerp(values[x + 1, y, z], values[x + 1, y, z + 1], ahead[2])
    a11 = wp.lerp(values[x + 1, y + 1, z], values[x + 1, y + 1, z + 1], ahead[2])
    d00 = values[x, y, z + 1] - values[x, y, z]
    d01 = values[x, y + 1, z + 1] - values[x, y + 1, z]
    d10 = values[x + 1, y, z + 1] - values[x + 1, y, z]
    d11 = values[x + 1, y + 1, z + 1] - values[x + 1, y + 1, z]
    return wp.vec3(
        wp.lerp(a10, a11, ahead[1]) - wp.lerp(a00, a01, ahead[1]),
        wp.lerp(a01 - a00, a11 - a10, ahead[0]),
        wp.lerp(wp.lerp(d00, d01, ahead[1]), wp.lerp(d10, d11, ahead[1]), ahead[0]),
    )


@wp.func
@no_type_check
def trilinear(values: wp.array3d[float], place: wp.vec3) -> float:
    """Value at a place; zero beyond the outermost nodes."""
    shape = wp.vec3i(values.shape[0], values.shape[1], values.shape[2])
    if not within(place, shape):
        return 0.0
    return blend(values, cell_about(place, shape))


@wp.kernel(enable_backward=False)
@no_type_check
def slope_kernel(
    start: int,
    origin: wp.vec3,
    spacing: float,
    shape: wp.vec3i,
    values: wp.array3d[float],
    points: wp.array[wp.vec3],
    value: wp.array[float],
    gradient: wp.array[wp.vec3],
) -> None:
    """Value and gradient of one channel; places beyond the border are clamped, and slopes across it vanish."""
    i = start + wp.tid()
    raw = (points[i] - origin) / spacing
    place = nearest_place(raw, shape)
    cell = cell_about(place, shape)
    steep = slope(values, cell)
    for k in range(3):
        if raw[k] != place[k]:
            steep[k] = 0.0
    value[i] = blend(values, cell)
    gradient[i] = steep / spacing


@wp.kernel(enable_backward=False)
@no_type_check
def sample_kernel(
    start: int,
    origin: wp.vec3,
    spacing: float,
    shape: wp.vec3i,
    values: wp.array2d[float],
    points: wp.array[wp.vec3],
    zero_outside: int,
    sampled: wp.array2d[float],
) -> None:
    """Every channel (node, channel) at each point; beyond the outermost nodes the border's values, or zero.

    `sampled` must be zero initially.
    """
    i = start + wp.tid()
    raw = (points[i] - origin) / spacing
    if zero_outside != 0 and not within(raw, shape):
        return
    cell = cell_about(nearest_place(raw, shape), shape)
    first = (cell.corner[0] * shape[1] + cell.corner[1]) * shape[2] + cell.corner[2]
    for channel in range(values.shape[1]):
        total = wp.float32(0.0)
        for k in range(8):
            x = k // 4
            y = (k // 2) % 2
            z = k % 2
            weight = wp.where(x == 1, cell.ahead[0], 1.0 - cell.ahead[0])
            weight *= wp.where(y == 1, cell.ahead[1], 1.0 - cell.ahead[1])
            weight *= wp.where(z == 1, cell.ahead[2], 1.0 - cell.ahead[2])
            total += weight * values[first + (x * shape[1] + y) * shape[2] + z, channel]
        sampled[i, channel] = total
