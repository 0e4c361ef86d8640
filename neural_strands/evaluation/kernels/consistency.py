"""Warp kernel of `consistency` (its array types mean nothing to Python's type checkers)."""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.geometry.kernels.point_queries import (
    Cells,
    LevelVector,
    outside_grid,
    row_of,
    row_on_ring,
    row_span,
    rows_on_ring,
)


@wp.func
@no_type_check
def count_match(
    strand: int,
    other: int,
    point: int,
    strictest: int,
    levels: int,
    slots: int,
    scratch: wp.array3d[int],
    best: wp.array2d[int],
) -> None:
    """Record that strand `other` matches a point from the level `strictest` on, unless the table is full.

    A slot stores the index of the other strand plus one and, for each level, how many points it matched and the last
    of them plus one. `best` takes the largest count of each level.
    """
    slot = other & (slots - 1)
    for _ in range(slots):
        holder = scratch[strand, slot, 0]
        if holder == 0:
            scratch[strand, slot, 0] = other + 1
            holder = other + 1
        if holder == other + 1:
            for level in range(strictest, levels):
                # What matches at a level also matches at all laxer ones.
                if scratch[strand, slot, 2 * level + 2] == point + 1:
                    return
                scratch[strand, slot, 2 * level + 2] = point + 1
                found = scratch[strand, slot, 2 * level + 1] + 1
                scratch[strand, slot, 2 * level + 1] = found
                best[strand, level] = wp.max(best[strand, level], found)
            return
        slot = (slot + 1) & (slots - 1)


@wp.kernel(enable_backward=False)
@no_type_check
def consistency_kernel(
    first_strand: int,
    points: wp.array[wp.vec3],
    starts: wp.array[int],
    cells: Cells,
    directions: wp.array[wp.vec3],
    curves: wp.array[int],
    true_points: wp.array[wp.vec3],
    true_directions: wp.array[wp.vec3],
    radii: LevelVector,
    cosines: LevelVector,
    levels: int,
    slots: int,
    offsets: wp.array[int],
    scratch: wp.array3d[int],
    best: wp.array2d[int],
) -> None:
    """One thread per true strand: count the points that each predicted strand matches, and keep the largest counts."""
    strand = first_strand + wp.tid()
    radius = radii[levels - 1]
    cosine = cosines[levels - 1]
    reach = int(radius / cells.size) + 1
    for i in range(offsets[strand], offsets[strand + 1]):
        query = true_points[i]
        if not outside_grid(query, radius, cells):
            centre = row_of(query, cells)
            for ring in range(reach + 1):
                for place in range(rows_on_ring(ring)):
                    row = row_on_ring(centre, ring, place)
                    span = row_span(query, row, radius, cells, starts)
                    for k in range(span[0], span[1]):
                        offset = points[k] - query
                        square = wp.dot(offset, offset)
                        alike = wp.abs(wp.dot(true_directions[i], directions[k]))
                        if alike >= cosine and square <= radius * radius:
                            strictest = int(levels - 1)
                            while (
                                strictest > 0
                                and square <= radii[strictest - 1] * radii[strictest - 1]
                                and alike >= cosines[strictest - 1]
                            ):
                                strictest -= 1
                            count_match(strand, curves[k], i, strictest, levels, slots, scratch, best)
