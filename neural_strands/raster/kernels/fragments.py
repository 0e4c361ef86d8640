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
def is_first(segment: wp.array2d[wp.int64], row: int, column: int, top: int, factor: int, part: wp.vec2i) -> bool:
    """Whether none of an image pixel's line pixels before this one sees this part; `top` is the pixel's first row."""
    left = column // factor * factor
    # Search backwards: the nearest pixels are the most likely to see the same part.
    before = column - 1
    while row >= top:
        while before >= left:
            seen = int(segment[row, before])
            if seen >= part[0] and seen <= part[1]:
                return False
            before -= 1
        row -= 1
        before = left + factor - 1
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
    # Most pixels see no hair; a division to find each line pixel would take longer than all else.
    for row in range(top, top + factor):
        for column in range(left, left + factor):
            here = int(segment[row, column])
            if here >= 0 and is_first(segment, row, column, top, factor, part_of(here, per_strand)):
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
    room: int,
    counts: wp.array[int],
    places: wp.array[int],
    pixels: wp.array[wp.int64],
    segments: wp.array[wp.int64],
    positions: wp.array[float],
    weights: wp.array[float],
) -> None:
    """List the parts that an image pixel sees, with their mean point and the number of line pixels that see them.

    Pixels whose parts do not all have room are left out.
    Until all line pixels have been seen, `segments` and `pixels` hold the first and last segment of a part, and
    `positions` the sum of positions.
    """
    pixel = start + wp.tid()
    if counts[pixel] == 0 or places[pixel] + counts[pixel] > room:
        return
    top = pixel // width * factor
    left = pixel % width * factor
    begin = places[pixel]
    end = begin
    for row in range(top, top + factor):
        for column in range(left, left + factor):
            here = segment[row, column]
            if here >= wp.int64(0):
                # The part that was found last is the most likely to be seen again.
                place = end - 1
                while place >= begin and (here < segments[place] or here > pixels[place]):
                    place -= 1
                if place < begin:
                    part = part_of(int(here), per_strand)
                    place = end
                    end += 1
                    segments[place] = wp.int64(part[0])
                    pixels[place] = wp.int64(part[1])
                positions[place] = positions[place] + (float(here - segments[place]) + position[row, column])
                weights[place] = weights[place] + 1.0
    for place in range(begin, end):
        along = positions[place] / weights[place]
        whole = wp.min(int(along), int(pixels[place] - segments[place]))
        segments[place] = segments[place] + wp.int64(whole)
        positions[place] = along - float(whole)
        pixels[place] = wp.int64(pixel)
