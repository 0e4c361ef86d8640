"""Warp kernels of `point_grid` and `point_queries`.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

MOST_LEVELS = 8
"""Largest number of thresholds in one call of `match_levels`."""

LevelVector = wp.types.vector(length=MOST_LEVELS, dtype=wp.float32)


@wp.struct
@no_type_check
class Cells:
    """The cells of a grid of points.

    Attributes:
        lower: corner of the first cell.
        count: cells along each axis.
        size: edge of a cell, metres.
        mask: largest key of the table of rows.
    """

    lower: wp.vec3
    count: wp.vec3i
    size: wp.float32
    mask: wp.int32


@wp.func
@no_type_check
def cell_along(coordinate: float, lower: float, inverse_cell: float) -> int:
    """Index of the cell that contains a coordinate."""
    return int(wp.floor((coordinate - lower) * inverse_cell))


@wp.func
@no_type_check
def row_start(y: int, z: int, mask: int) -> int:
    """Start of the row of cells at (y, z) in the table."""
    return ((y * 73856093) ^ (z * 19349663)) & mask


@wp.kernel(enable_backward=False)
@no_type_check
def count_points(
    points: wp.array[wp.vec3],
    lower: wp.vec3,
    inverse_cell: float,
    mask: int,
    keys: wp.array[int],
    counts: wp.array[int],
) -> None:
    """Key of each point's cell, and the number of points per key."""
    i = wp.tid()
    p = points[i]
    y = cell_along(p[1], lower[1], inverse_cell)
    z = cell_along(p[2], lower[2], inverse_cell)
    key = row_start(y, z, mask) + cell_along(p[0], lower[0], inverse_cell)
    keys[i] = key
    wp.atomic_add(counts, key, 1)


@wp.kernel(enable_backward=False)
@no_type_check
def place_points(
    points: wp.array[wp.vec3],
    keys: wp.array[int],
    cursor: wp.array[int],
    sorted_points: wp.array[wp.vec3],
    order: wp.array[int],
) -> None:
    """Move each point to the run of its cell (counting sort)."""
    i = wp.tid()
    slot = wp.atomic_add(cursor, keys[i], 1)
    order[slot] = i
    sorted_points[slot] = points[i]


@wp.func
@no_type_check
def row_of(point: wp.vec3, cells: Cells) -> wp.vec2i:
    """The y and z of the row of cells that contains a point."""
    inverse = 1.0 / cells.size
    return wp.vec2i(cell_along(point[1], cells.lower[1], inverse), cell_along(point[2], cells.lower[2], inverse))


@wp.func
@no_type_check
def rows_on_ring(ring: int) -> int:
    """Number of rows at a distance of `ring` rows from one along y or z; one on ring 0."""
    return wp.max(8 * ring, 1)


@wp.func
@no_type_check
def row_on_ring(centre: wp.vec2i, ring: int, k: int) -> wp.vec2i:
    """The y and z of the k-th of those rows: along the four sides of a square, each without its last corner."""
    if ring == 0:
        return centre
    side = k // (2 * ring)
    along = k - side * 2 * ring - ring
    if side == 0:
        return wp.vec2i(centre[0] - ring, centre[1] + along)
    if side == 1:
        return wp.vec2i(centre[0] + along, centre[1] + ring)
    if side == 2:
        return wp.vec2i(centre[0] + ring, centre[1] - along)
    return wp.vec2i(centre[0] - along, centre[1] - ring)


@wp.func
@no_type_check
def row_span(
    query: wp.vec3,
    row: wp.vec2i,
    reach: float,
    cells: Cells,
    starts: wp.array[int],
) -> wp.vec2i:
    """The run of sorted points in a row (y, z) whose cells come within `reach` of the query."""
    y = row[0]
    z = row[1]
    if y < 0 or z < 0 or y >= cells.count[1] or z >= cells.count[2]:
        return wp.vec2i(0, 0)
    below = cells.lower[1] + float(y) * cells.size - query[1]
    beside = cells.lower[2] + float(z) * cells.size - query[2]
    gap_y = wp.max(wp.max(below, -below - cells.size), 0.0)
    gap_z = wp.max(wp.max(beside, -beside - cells.size), 0.0)
    # The tolerance is needed because the cell of a point and the distance to a cell are rounded separately.
    square = reach * reach * 1.0001 + 1.0e-14 - gap_y * gap_y - gap_z * gap_z
    if square < 0.0:
        return wp.vec2i(0, 0)
    half = wp.sqrt(square) + 1.0e-6 * cells.size
    first = wp.max(cell_along(query[0] - half, cells.lower[0], 1.0 / cells.size), 0)
    last = wp.min(cell_along(query[0] + half, cells.lower[0], 1.0 / cells.size), cells.count[0] - 1)
    if first > last:
        return wp.vec2i(0, 0)
    base = row_start(y, z, cells.mask)
    return wp.vec2i(starts[base + first], starts[base + last + 1])


@wp.func
@no_type_check
def outside_grid(query: wp.vec3, radius: float, cells: Cells) -> bool:
    """Whether a query is too far from the grid's box to find anything, or not finite."""
    outside = wp.bool(False)
    for axis in range(3):
        offset = query[axis] - cells.lower[axis]
        if not (offset >= -radius and offset <= float(cells.count[axis]) * cells.size + radius):
            outside = True
    return outside


@wp.kernel(enable_backward=False)
@no_type_check
def nearest_kernel(
    first_query: int,
    points: wp.array[wp.vec3],
    starts: wp.array[int],
    cells: Cells,
    order: wp.array[int],
    queries: wp.array[wp.vec3],
    radius: float,
    distance: wp.array[float],
    index: wp.array[int],
) -> None:
    """Visit rings of rows around the query's own, from near to far, until a ring is farther than the best point."""
    i = first_query + wp.tid()
    query = queries[i]
    if outside_grid(query, radius, cells):
        return
    centre = row_of(query, cells)
    best = radius * radius
    chosen = wp.int32(-1)
    rings = int(radius / cells.size) + 2
    for ring in range(rings):
        if float(ring - 1) * cells.size > wp.sqrt(best):
            break
        for place in range(rows_on_ring(ring)):
            row = row_on_ring(centre, ring, place)
            span = row_span(query, row, wp.sqrt(best), cells, starts)
            for k in range(span[0], span[1]):
                offset = points[k] - query
                square = wp.dot(offset, offset)
                if square < best or (square == best and (chosen < 0 or order[k] < chosen)):
                    best = square
                    chosen = order[k]
    if chosen >= 0:
        distance[i] = wp.sqrt(best)
        index[i] = chosen


@wp.kernel(enable_backward=False)
@no_type_check
def levels_kernel(
    first_query: int,
    points: wp.array[wp.vec3],
    starts: wp.array[int],
    cells: Cells,
    directions: wp.array[wp.vec3],
    queries: wp.array[wp.vec3],
    query_directions: wp.array[wp.vec3],
    radii: LevelVector,
    cosines: LevelVector,
    levels: int,
    unsigned_level: wp.array[int],
    signed_level: wp.array[int],
) -> None:
    """Visit rings of rows around the query's own; the reach shrinks to the radius of the next stricter level."""
    i = first_query + wp.tid()
    query = queries[i]
    if outside_grid(query, radii[levels - 1], cells):
        return
    direction = query_directions[i]
    centre = row_of(query, cells)
    unsigned = int(levels)
    signed = int(levels)
    reach = float(radii[levels - 1])
    rings = int(reach / cells.size) + 2
    for ring in range(rings):
        if signed == 0 or float(ring - 1) * cells.size > reach:
            break
        for place in range(rows_on_ring(ring)):
            if signed > 0:
                row = row_on_ring(centre, ring, place)
                span = row_span(query, row, reach, cells, starts)
                for k in range(span[0], span[1]):
                    offset = points[k] - query
                    square = wp.dot(offset, offset)
                    if square <= reach * reach:
                        cosine = wp.dot(direction, directions[k])
                        while (
                            unsigned > 0
                            and square <= radii[unsigned - 1] * radii[unsigned - 1]
                            and wp.abs(cosine) >= cosines[unsigned - 1]
                        ):
                            unsigned -= 1
                        while (
                            signed > 0
                            and square <= radii[signed - 1] * radii[signed - 1]
                            and cosine >= cosines[signed - 1]
                        ):
                            signed -= 1
                        # A signed match is also an unsigned one, so the signed level is never the stricter.
                        reach = radii[wp.max(signed - 1, 0)]
                        if signed == 0:
                            break
    unsigned_level[i] = unsigned
    signed_level[i] = signed
