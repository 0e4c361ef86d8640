"""Warp kernels over an oriented point cloud: mean shift along the normal plane, and growing of chains."""

# ruff: noqa: UP018, RUF046  (to Warp, the cast makes a variable of a constant)
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.struct
@no_type_check
class Local:
    """The mean line around a position.

    Attributes:
        point: the position, shifted across the line to the weighted mean of its neighbours.
        direction: mean direction, with the sign of the given one.
        weight: sum of the neighbours' weights; 0 where there are none.
        spread: weighted mean square distance of the neighbours across the line, square metres.
    """

    point: wp.vec3
    direction: wp.vec3
    weight: float
    spread: float


@wp.func
@no_type_check
def mean_line(
    grid: wp.uint64,
    points: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    weights: wp.array[float],
    place: wp.vec3,
    direction: wp.vec3,
    radius: float,
    least_cosine: float,
) -> Local:
    """Mean shift of a position across its line, over the neighbours within `radius` of similar direction."""
    shift = wp.vec3()
    turned = wp.vec3()
    total = float(0.0)
    spread = float(0.0)
    inverse = 1.0 / (0.5 * radius * radius)
    query = wp.hash_grid_query(grid, place, radius)
    index = int(0)
    while wp.hash_grid_query_next(query, index):
        offset = points[index] - place
        square = wp.dot(offset, offset)
        cosine = wp.dot(directions[index], direction)
        if square < radius * radius and wp.abs(cosine) > least_cosine:
            across = offset - direction * wp.dot(offset, direction)
            weight = weights[index] * wp.exp(-square * inverse)
            shift += across * weight
            turned += directions[index] * (wp.sign(cosine) * weight)
            spread += wp.dot(across, across) * weight
            total += weight
    result = Local()
    result.point = place
    result.direction = direction
    result.weight = total
    if total > 0.0:
        result.point = place + shift / total
        result.direction = wp.normalize(turned)
        result.spread = spread / total
    return result


@wp.kernel(enable_backward=False)
@no_type_check
def shift_points(
    start: int,
    grid: wp.uint64,
    points: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    weights: wp.array[float],
    radius: float,
    least_cosine: float,
    rounds: int,
    moved: wp.array[wp.vec3],
    turned: wp.array[wp.vec3],
    support: wp.array[float],
) -> None:
    """Move each point across its line towards its neighbours, and align it with them."""
    i = start + wp.tid()
    place = points[i]
    direction = directions[i]
    weight = float(0.0)
    for _round in range(rounds):
        local = mean_line(grid, points, directions, weights, place, direction, radius, least_cosine)
        place = local.point
        direction = local.direction
        weight = local.weight
    moved[i] = place
    turned[i] = direction
    support[i] = weight


@wp.kernel(enable_backward=False)
@no_type_check
def grow(
    start: int,
    grid: wp.uint64,
    points: wp.array[wp.vec3],
    directions: wp.array[wp.vec3],
    weights: wp.array[float],
    seeds: wp.array[int],
    radius: float,
    step: float,
    least_weight: float,
    least_cosine: float,
    turn_cosine: float,
    chain: wp.array(dtype=wp.vec3, ndim=3),
    tangent: wp.array(dtype=wp.vec3, ndim=3),
    strength: wp.array3d(dtype=float),
    length: wp.array2d(dtype=int),
) -> None:
    """Walk from each seed in both directions, pulling each step onto the mean line of its neighbours."""
    tid = start + wp.tid()
    i = seeds[tid // 2]
    way = tid % 2
    place = points[i]
    direction = directions[i]
    if way == 1:
        direction = -direction
    seed = tid // 2
    count = int(0)
    for k in range(chain.shape[2]):
        ahead = place + direction * step
        local = mean_line(grid, points, directions, weights, ahead, direction, radius, least_cosine)
        if local.weight < least_weight or wp.dot(local.direction, direction) < turn_cosine:
            break
        place = local.point
        direction = local.direction
        chain[seed, way, k] = place
        tangent[seed, way, k] = direction
        strength[seed, way, k] = local.weight
        count += 1
    length[seed, way] = count
