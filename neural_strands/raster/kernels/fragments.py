"""Warp kernels that gather the parts of strands that each image pixel sees (see `visible.visible_points`).

A part of a strand is a run of a few segments, given by its first and last segment.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

RUN = wp.constant(2)
"""Segments per part; longer parts would merge two passes of a curl through one pixel."""


@wp.func
@no_type_check
def part_of(segment: int, per_strand: int) -> wp.vec2i:
    """First and last segment of the part that a segment belongs to."""
    strand = segment // per_strand * per_strand
    first = strand + (segment - strand) // RUN * RUN
    return wp.vec2i(first, wp.min(first + RUN, strand + per_strand) - 1)


@wp.func
@no_type_check
def is_first(segment: wp.array2d[wp.int64], top: int, left: int, k: int, factor: int, part: wp.vec2i) -> bool:
    """Whether none of an image pixel's line pixels before the k-th sees this part."""
    # Search backwards: the nearest pixels are the most likely to see the same part.
    row = k // factor
    column = k - row * factor - 1
    while row >= 0:
        while column >= 0:
            seen = int(segment[top + row, left + column])
            if seen >= part[0] and seen <= part[1]:
                return False
            column -= 1
        row -= 1
        column = factor - 1
    return True


@wp.kernel(enable_backward=False)
@no_type_check
def count_parts(
    start: int, segment: wp.array2d[wp.int64], width: int, factor: int, per_strand: int, count: wp.array[int]
) -> None:
    """Count the parts of strands that an image pixel sees."""
    pixel = start + wp.tid()
    top = pixel // width * factor
    left = pixel % width * factor
    found = wp.int32(0)
    for k in range(factor * factor):
        here = int(segment[top + k // factor, left + k % factor])
        if here >= 0 and is_first(segment, top, left, k, factor, part_of(here, per_strand)):
            found += 1
    count[pixel] = found


@wp.kernel(enable_backward=False)
@no_type_check
def gather_parts(
    start: int,
    segment: wp.array2d[wp.int64],
    position: wp.array2d[float],
    width: int,
    factor: int,
    per_strand: int,
    places: wp.array[int],
    pixels: wp.array[wp.int64],
    segments: wp.array[wp.int64],
    positions: wp.array[float],
    weights: wp.array[float],
) -> None:
    """List the parts that an image pixel sees, with their mean point and the number of line pixels that see them."""
    pixel = start + wp.tid()
    top = pixel // width * factor
    left = pixel % width * factor
    place = places[pixel]
    for k in range(factor * factor):
        here = int(segment[top + k // factor, left + k % factor])
        if here >= 0:
            part = part_of(here, per_strand)
            if is_first(segment, top, left, k, factor, part):
                total = wp.float32(0.0)
                weight = wp.float32(0.0)
                for row in range(k // factor, factor):
                    for column in range(factor):
                        seen = int(segment[top + row, left + column])
                        if seen >= part[0] and seen <= part[1]:
                            total += float(seen - part[0]) + position[top + row, left + column]
                            weight += 1.0
                along = total / weight
                whole = wp.min(int(along), part[1] - part[0])
                pixels[place] = wp.int64(pixel)
                segments[place] = wp.int64(part[0] + whole)
                positions[place] = along - float(whole)
                weights[place] = weight
                place += 1
