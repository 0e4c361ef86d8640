"""Warp kernels that draw wide strands on the CPU without the segments that hair in front of them hides.

In dense hair, nine of ten segments are hidden. The picture is divided into blocks. Every block keeps the inverse depth
of its farthest pixel drawn so far, here called its veil. A segment that lies behind the veils of all blocks that it may
touch changes no pixel and is left out. `raster.occlusion` launches these kernels.

Veils have three levels, with blocks of `BLOCK`, twice and four times as many pixels a side. The entry of a block is the
least veil of that block and of its neighbours to the right, below and diagonally below, so that one look-up serves a
segment as large as a block. The levels follow each other in one array.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.raster.kernels.keys import key_depth
from neural_strands.raster.kernels.lines import draw_in_front, end_radii, focal_length, to_screen, transform

BLOCK = wp.constant(8)
"""Pixels a side of the smallest blocks; `list_unhidden` knows its double and its fourfold, and their inverses."""
BATCH = wp.constant(64)
"""Segments per batch."""
ENDS = wp.constant(65)
"""Points per batch."""
MARGIN = wp.constant(1.00001)
"""Factor by which a hidden segment must lie behind the veil; more than rounding."""
STRETCH = wp.constant(1.4143)
"""Largest width of a line along a row or column, in widths: that of an inclined line."""
ALWAYS = wp.constant(1.0e30)
"""Inverse depth of a segment that no veil hides."""


@wp.kernel(enable_backward=False)
@no_type_check
def veil_blocks(keys: wp.array[wp.int64], width: int, height: int, across: int, veil: wp.array[float]) -> None:
    """Inverse depth of a block's farthest pixel; 0 if nothing has been drawn to one of them."""
    block = wp.tid()
    top = block // across * BLOCK
    left = block % across * BLOCK
    farthest = wp.int64(0)
    for row in range(top, wp.min(top + BLOCK, height)):
        for column in range(left, wp.min(left + BLOCK, width)):
            farthest = wp.max(farthest, keys[row * width + column])
    veil[block] = 1.0 / key_depth(farthest)


@wp.kernel(enable_backward=False)
@no_type_check
def spread_veils(
    veil: wp.array[float], across: int, down: int, level: int, start: int, levels: wp.array[float]
) -> None:
    """One entry of a level, from the veils of the smallest blocks.

    Args:
        veil: of the smallest blocks.
        across: number of the smallest blocks in a row.
        down: number of their rows.
        level: 0, 1 or 2.
        start: place of the level's first entry.
        levels: entries of all levels.
    """
    entry = wp.tid()
    size = 1 << level
    entries = (across + size - 1) // size
    top = entry // entries * size
    left = entry % entries * size
    least = wp.float32(ALWAYS)
    for row in range(top, wp.min(top + 2 * size, down)):
        for column in range(left, wp.min(left + 2 * size, across)):
            least = wp.min(least, veil[row * across + column])
    levels[start + entry] = least


@wp.kernel(enable_backward=False)
@no_type_check
def list_unhidden(
    first: int,
    step: int,
    points: wp.array[wp.vec3],
    projections: wp.array[wp.mat44],
    near: float,
    strand_width: float,
    points_per_strand: int,
    width: int,
    height: int,
    across: int,
    down: int,
    levels: wp.array[float],
    listed: wp.array[int],
    counts: wp.array[int],
) -> None:
    """List the segments of one strand that the veils do not hide and that touch the picture.

    As in `line_batches`, all segments of a batch take each step together, in loops that the compiler turns into vector
    instructions. It does so only if the loops are written out, array elements have names, and nothing is drawn here.
    """
    item = wp.tid()
    strand = first + item * step
    segments = points_per_strand - 1
    projection = projections[0]
    # Per point: first world x, y, z, later pixel x, pixel y and inverse depth.
    x = wp.zeros(shape=(ENDS,), dtype=float)
    y = wp.zeros(shape=(ENDS,), dtype=float)
    z = wp.zeros(shape=(ENDS,), dtype=float)
    # Per segment: its entry among the levels, and its inverse depth where it is nearest.
    places = wp.zeros(shape=(BATCH,), dtype=int)
    nearest = wp.zeros(shape=(BATCH,), dtype=float)
    half = STRETCH * 0.5 * strand_width * focal_length(projection)
    columns = float(width)
    rows = float(height)
    across_2 = (across + 1) // 2
    across_4 = (across + 3) // 4
    start_2 = across * down
    start_4 = start_2 + across_2 * ((down + 1) // 2)
    found = wp.int32(0)
    done = wp.int32(0)
    while done < segments:
        count = wp.min(BATCH, segments - done)
        base = strand * points_per_strand + done
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
        # All segments of a batch that reaches behind the near plane are listed.
        whole = wp.where(behind > 0, 0, count)
        k = wp.int32(0)
        while k < whole:
            ax = x[k]
            ay = y[k]
            az = z[k]
            bx = x[k + 1]
            by = y[k + 1]
            bz = z[k + 1]
            close = wp.max(az, bz)
            reach = half * close + 0.01
            left = wp.min(ax, bx) - reach
            right = wp.max(ax, bx) + reach
            top = wp.min(ay, by) - reach
            bottom = wp.max(ay, by) + reach
            extent = wp.max(right - left, bottom - top)
            fits = extent < 32.0
            seen = right >= 0.0 and left < columns and bottom >= 0.0 and top < rows
            scale = wp.where(extent < 8.0, 0.125, wp.where(extent < 16.0, 0.0625, 0.03125))
            entries = wp.where(extent < 8.0, across, wp.where(extent < 16.0, across_2, across_4))
            start = wp.where(extent < 8.0, 0, wp.where(extent < 16.0, start_2, start_4))
            place = start + int(wp.max(top, 0.0) * scale) * entries + int(wp.max(left, 0.0) * scale)
            places[k] = wp.where(fits and seen, place, 0)
            # A segment beside the picture lies behind every veil. One that is too large or not finite is listed.
            nearest[k] = wp.where(fits, wp.where(seen, close * MARGIN, -1.0), ALWAYS)
            k += 1
        k = wp.int32(0)
        while k < whole:
            listed[item * segments + found] = done + k
            found += wp.where(nearest[k] < levels[places[k]], 0, 1)
            k += 1
        while k < count:
            listed[item * segments + found] = done + k
            found += 1
            k += 1
        done += count
    counts[item] = found


@wp.kernel(enable_backward=False)
@no_type_check
def draw_listed(
    first: int,
    step: int,
    points: wp.array[wp.vec3],
    projections: wp.array[wp.mat44],
    near: float,
    strand_width: float,
    tip: float,
    parameters: wp.array[float],
    points_per_strand: int,
    width: int,
    height: int,
    listed: wp.array[int],
    counts: wp.array[int],
    keys: wp.array[wp.int64],
) -> None:
    """Draw the listed segments of one strand as `lines.draw_lines` does."""
    item = wp.tid()
    strand = first + item * step
    segments = points_per_strand - 1
    base = strand * points_per_strand
    projection = projections[0]
    radius = 0.5 * strand_width * focal_length(projection)
    b = wp.vec3(0.0, 0.0, 0.0)
    b_screen = wp.vec3(0.0, 0.0, 0.0)
    following = wp.int32(-1)
    for j in range(counts[item]):
        k = listed[item * segments + j]
        a = b
        a_screen = b_screen
        if k != following:
            a = transform(projection, points[base + k])
            a_screen = to_screen(a)
        b = transform(projection, points[base + k + 1])
        b_screen = to_screen(b)
        following = k + 1
        radii = end_radii(radius, tip, parameters, strand, k, points_per_strand)
        if radii[0] > 0.0 or radii[1] > 0.0:
            index = strand * segments + k
            draw_in_front(a, b, a_screen, b_screen, near, radii, index, wp.vec2i(width, height), keys)
