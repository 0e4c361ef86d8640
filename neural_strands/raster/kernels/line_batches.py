"""The line rasteriser's CPU kernel for lines one pixel wide; it draws exactly what `lines.draw_lines` draws.

A segment is about a pixel long, so branches on its direction and on its number of pixels are mispredicted half of the
time. Here all segments of a batch take each step together, without branches, in loops that the compiler vectorises.
Only the keys are updated one by one.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.raster.kernels.keys import NOT_DRAWN, key_of_bits
from neural_strands.raster.kernels.lines import LONGEST, depth_at, draw_in_front, draw_segment, to_screen, transform

BATCH = wp.constant(64)
"""Segments per batch."""
ENDS = wp.constant(65)
"""Points per batch."""


@wp.kernel(enable_backward=False)
@no_type_check
def draw_strands(
    first: int,
    points: wp.array[wp.vec3],
    projections: wp.array[wp.mat44],
    near: float,
    points_per_strand: int,
    width: int,
    height: int,
    keys: wp.array[wp.int64],
) -> None:
    """Draw one strand. The image has at least one pixel.

    The loops are written out here rather than in functions, and array elements are assigned to variables before a
    choice between them. Otherwise the compiler selects addresses and emits gathers, or no vector instructions at all,
    and the code is three times as slow.
    """
    strand = first + wp.tid()
    projection = projections[0]
    # Per point: first world x, y, z, later pixel x, pixel y and inverse depth.
    x = wp.zeros(shape=(ENDS,), dtype=float)
    y = wp.zeros(shape=(ENDS,), dtype=float)
    z = wp.zeros(shape=(ENDS,), dtype=float)
    # Per segment: its first pixel, the bits of its depth there, and whether there are more pixels.
    pixels = wp.zeros(shape=(BATCH,), dtype=int)
    depths = wp.zeros(shape=(BATCH,), dtype=int)
    longer = wp.zeros(shape=(BATCH,), dtype=int)
    one_wide = wp.vec2(0.0, 0.0)
    columns = float(width)
    rows = float(height)
    done = wp.int32(0)
    while done < points_per_strand - 1:
        count = wp.min(BATCH, points_per_strand - 1 - done)
        base = strand * points_per_strand + done
        index = strand * (points_per_strand - 1) + done
        k = wp.int32(0)
        while k <= count:
            point = points[base + k]
            x[k] = point[0]
            y[k] = point[1]
            z[k] = point[2]
            k += 1
        behind = wp.int32(0)
        k = wp.int32(0)
        while k <= count:
            moved = transform(projection, wp.vec3(x[k], y[k], z[k]))
            end = to_screen(moved)
            x[k] = end[0]
            y[k] = end[1]
            z[k] = end[2]
            behind += wp.where(moved[2] > near, 0, 1)
            k += 1
        # A batch that reaches behind the near plane is drawn segment by segment, after the loops.
        whole = wp.where(behind > 0, 0, count)
        k = wp.int32(0)
        while k < whole:
            ax = x[k]
            ay = y[k]
            az = z[k]
            bx = x[k + 1]
            by = y[k + 1]
            bz = z[k + 1]
            dx = bx - ax
            dy = by - ay
            along_x = wp.abs(dx) >= wp.abs(dy)
            a_major = wp.where(along_x, ax, ay)
            b_major = wp.where(along_x, bx, by)
            a_minor = wp.where(along_x, ay, ax)
            d_major = wp.where(along_x, dx, dy)
            d_minor = wp.where(along_x, dy, dx)
            low = wp.max(wp.min(a_major, b_major), 0.0)
            high = wp.min(wp.max(a_major, b_major), wp.where(along_x, columns, rows))
            start = int(wp.ceil(low - 0.5))
            stop = int(wp.ceil(high - 0.5))
            fraction = (float(start) + 0.5 - a_major) / d_major
            minor = a_minor + fraction * d_minor
            across = minor >= 0.0 and minor < wp.where(along_x, rows, columns)
            drawn = start < stop and across and wp.abs(d_major) < LONGEST
            pixel = start * wp.where(along_x, 1, width) + int(minor) * wp.where(along_x, width, 1)
            pixels[k] = wp.where(drawn, pixel, 0)
            depths[k] = wp.where(drawn, wp.cast(depth_at(fraction, az, bz), wp.int32), NOT_DRAWN)
            longer[k] = wp.where(start + 1 < stop, 1, 0)
            k += 1
        k = wp.int32(0)
        while k < whole:
            wp.atomic_min(keys, pixels[k], key_of_bits(depths[k], index + k))
            if longer[k] > 0:
                a = wp.vec3(x[k], y[k], z[k])
                b = wp.vec3(x[k + 1], y[k + 1], z[k + 1])
                draw_segment(a, b, index + k, width, height, keys)
            k += 1
        while k < count:
            p = transform(projection, points[base + k])
            q = transform(projection, points[base + k + 1])
            draw_in_front(p, q, to_screen(p), to_screen(q), near, one_wide, index + k, wp.vec2i(width, height), keys)
            k += 1
        done += count
