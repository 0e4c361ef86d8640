"""The CPU's kernel for activations at twice the resolution; it computes what `resample.filtered_leaky_relu` describes.

Rows are interpolated, activated and filtered as they are needed, so that everything between input and output stays in
the cache. Channels are in vectors of 16. Each instruction handles several vectors that follow each other, a span.
Where their number is not a multiple of a span's, the last span overlaps the one before it.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import no_type_check

import warp as wp

CHANNELS = 16
"""Channels of one vector."""
SPAN = 4
"""Vectors of one span. A tile has at least as many."""
TAPS = 12
"""Coefficients of the filters."""
REACH = 6
"""Pixels beside a tile on each side that its interpolated rows depend on."""
Filter = wp.types.vector(length=TAPS, dtype=wp.float32)
Span = wp.types.vector(length=SPAN * CHANNELS, dtype=wp.float32)
LEAKY_SLOPE = 0.2
CLAMP = 256.0
"""Activations are clamped here: far outside the values of a trained network, but within half precision."""
_TAPS = wp.constant(TAPS)
_SPAN = wp.constant(SPAN)
_SLOPE = wp.constant(LEAKY_SLOPE)
_CLAMP = wp.constant(CLAMP)


@wp.func
@no_type_check
def sum_of_six(
    values: wp.array[Span], first: int, step: int, a: float, b: float, c: float, d: float, e: float, f: float
) -> Span:
    """Six values, `step` apart, with weights."""
    start = a * values[first] + b * values[first + step] + c * values[first + 2 * step]
    return start + d * values[first + 3 * step] + e * values[first + 4 * step] + f * values[first + 5 * step]


@wp.kernel(enable_backward=False)
@no_type_check
def filtered_activation(
    first_job: int,
    images: wp.array[Span],
    bias: wp.array[Span],
    up: Filter,
    down: Filter,
    height: int,
    width: int,
    c: int,
    rows: int,
    tile: int,
    tall: wp.array[Span],
    even: wp.array[Span],
    odd: wp.array[Span],
    ring: wp.array[Span],
    result: wp.array[Span],
) -> None:
    """Filter one tile of `rows` by `tile` pixels; jobs that share the work arrays must run one after the other.

    Vectors are in the order row, column, channel, `c` of them a pixel. `bias` holds the bias for every pixel of a tile
    and its surroundings. `tall` holds a fine row at the coarse columns, `even` and `odd` the activated fine pixels of
    that row, and `ring` the last twelve fine rows, filtered along the row; each is kept twice, so that they always lie
    one after the other. Fine pixels outside the image are zero.
    """
    job = first_job + wp.tid()
    across = (width + tile - 1) // tile
    top = job // across * rows
    left = (job % across) * tile
    bottom = wp.min(top + rows, height)
    count = wp.min(tile, width - left)
    low = wp.max(left - REACH, 0)
    inside = (wp.min(left + count + REACH, width) - low) * c
    skipped = (low - left + REACH) * c
    fine_size = (count + REACH) * c
    n = count * c
    # The fine pixels of the image; those beside them stay zero.
    lead = wp.max(3 - left, 0) * c
    trail = fine_size - wp.max(left + count + 3 - width, 0) * c
    for e in range((count + 2 * REACH) * c - _SPAN + 1):
        tall[e] = Span(0.0)
    for e in range(fine_size - _SPAN + 1):
        even[e] = Span(0.0)
        odd[e] = Span(0.0)
    for fine in range(2 * top - 5, 2 * bottom + 5):
        slot = ((fine + _TAPS) % _TAPS) * n
        if fine < 0 or fine >= 2 * height:
            for j in range(0, n, _SPAN):
                e = wp.min(j, n - _SPAN)
                ring[slot + e] = Span(0.0)
                ring[slot + _TAPS * n + e] = Span(0.0)
        else:
            # Even fine rows lie above the centre of their coarse row, odd ones below.
            odd_row = fine % 2
            row = fine // 2 - 3 + odd_row
            w0 = wp.where(row >= 0, wp.where(odd_row == 0, up[11], up[10]), 0.0)
            w1 = wp.where(row + 1 >= 0, wp.where(odd_row == 0, up[9], up[8]), 0.0)
            w2 = wp.where(row + 2 >= 0, wp.where(odd_row == 0, up[7], up[6]), 0.0)
            w3 = wp.where(row + 3 < height, wp.where(odd_row == 0, up[5], up[4]), 0.0)
            w4 = wp.where(row + 4 < height, wp.where(odd_row == 0, up[3], up[2]), 0.0)
            w5 = wp.where(row + 5 < height, wp.where(odd_row == 0, up[1], up[0]), 0.0)
            r0 = (wp.max(row, 0) * width + low) * c
            r1 = (wp.max(row + 1, 0) * width + low) * c
            r2 = (wp.max(row + 2, 0) * width + low) * c
            r3 = (wp.min(row + 3, height - 1) * width + low) * c
            r4 = (wp.min(row + 4, height - 1) * width + low) * c
            r5 = (wp.min(row + 5, height - 1) * width + low) * c
            total = w0 + w1 + w2 + w3 + w4 + w5
            for j in range(0, inside, _SPAN):
                e = wp.min(j, inside - _SPAN)
                tall[skipped + e] = total * bias[e] + (
                    w0 * images[r0 + e]
                    + w1 * images[r1 + e]
                    + w2 * images[r2 + e]
                    + w3 * images[r3 + e]
                    + w4 * images[r4 + e]
                    + w5 * images[r5 + e]
                )
            for j in range(lead, trail, _SPAN):
                e = wp.min(j, trail - _SPAN)
                x = sum_of_six(tall, e, c, up[11], up[9], up[7], up[5], up[3], up[1])
                even[e] = wp.max(x, _SLOPE * x)
            for j in range(lead, trail, _SPAN):
                e = wp.min(j, trail - _SPAN)
                x = sum_of_six(tall, e + c, c, up[10], up[8], up[6], up[4], up[2], up[0])
                odd[e] = wp.max(x, _SLOPE * x)
            for j in range(0, n, _SPAN):
                e = wp.min(j, n - _SPAN)
                from_even = sum_of_six(even, e + c, c, down[1], down[3], down[5], down[7], down[9], down[11])
                x = from_even + sum_of_six(odd, e, c, down[0], down[2], down[4], down[6], down[8], down[10])
                ring[slot + e] = x
                ring[slot + _TAPS * n + e] = x
        if fine % 2 == 0 and fine - REACH >= 2 * top:
            place = (fine - REACH) // 2 * width * c + left * c
            first = ((fine + 1) % _TAPS) * n
            for j in range(0, n, _SPAN):
                e = wp.min(j, n - _SPAN)
                upper = sum_of_six(ring, first + e, n, down[0], down[1], down[2], down[3], down[4], down[5])
                lower = sum_of_six(ring, first + 6 * n + e, n, down[6], down[7], down[8], down[9], down[10], down[11])
                result[place + e] = wp.min(wp.max(upper + lower, Span(-_CLAMP)), Span(_CLAMP))
