"""Kernels of one-dimensional filters along one axis, with zeros put between samples or samples left out.

Each thread computes one output, or four neighbouring ones in bfloat16. The sums are in float32.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false, reportInvalidTypeForm=false

from typing import no_type_check

import warp as wp

PLAIN, ACTIVATE, GATE = 0, 1, 2
"""What happens to a sum: nothing; leaky ReLU; the gradient of leaky ReLU, by the sign of what it had returned."""
_ACTIVATE, _GATE = wp.constant(ACTIVATE), wp.constant(GATE)


@wp.struct
@no_type_check
class Axis:
    """The filter and the axis that it runs along.

    Output i is the sum over inputs j of taps[j * up - i * down + pad] * input[j].

    Attributes:
        up: fine samples per input.
        down: fine samples per output.
        pad: fine samples before the first input that the first output's taps begin at.
        taps: number of coefficients.
        length: number of inputs along the axis.
        new_length: number of outputs.
        inner: number of values between neighbours along the axis; for the kernel of bfloat16, of fours.
        origin: place of the first coefficient.
        turn: 1, or -1 if the coefficients are read from the last to the first.
        finish: `PLAIN`, `ACTIVATE` or `GATE`.
        gain: factor of the sums.
        slope: of leaky ReLU for negative values.
    """

    up: int
    down: int
    pad: int
    taps: int
    length: int
    new_length: int
    inner: int
    origin: int
    turn: int
    finish: int
    gain: float
    slope: float


@wp.func
@no_type_check
def finished(total: float, before: float, axis: Axis) -> float:
    """A sum with its gain, after what `axis.finish` says; `before` is what leaky ReLU had returned."""
    found = axis.gain * total
    if axis.finish == _ACTIVATE:
        return wp.max(found, axis.slope * found)
    if axis.finish == _GATE and before < 0.0:
        return axis.slope * found
    return found


@wp.func
@no_type_check
def first_input(axis: Axis, begin: int) -> int:
    """The first input at or after a fine sample."""
    if begin <= 0:
        return 0
    return (begin + axis.up - 1) // axis.up


@wp.func
@no_type_check
def places(item: int, axis: Axis) -> wp.vec2i:
    """Of an output, by its number: where the inputs of its line begin, and the fine sample at which its taps begin."""
    row = item // axis.inner
    outer = row // axis.new_length
    base = outer * axis.length * axis.inner + item - row * axis.inner
    return wp.vec2i(base, (row - outer * axis.new_length) * axis.down - axis.pad)


@wp.kernel(enable_backward=False)
@no_type_check
def filter_floats(
    start: int,
    weights: wp.array[float],
    axis: Axis,
    values: wp.array[float],
    gate: wp.array[float],
    result: wp.array[float],
) -> None:
    """Compute one output."""
    item = start + wp.tid()
    place = places(item, axis)
    total = wp.float32(0.0)
    j = first_input(axis, place[1])
    tap = j * axis.up - place[1]
    while j < axis.length and tap < axis.taps:
        total += weights[axis.origin + axis.turn * tap] * values[place[0] + j * axis.inner]
        j += 1
        tap += axis.up
    before = wp.float32(0.0)
    if axis.finish == _GATE:
        before = gate[item]
    result[item] = finished(total, before, axis)


@wp.func
@no_type_check
def as_floats(four: wp.uint64) -> wp.vec4:
    """Four bfloat16 as float32."""
    low = wp.uint32(four)
    high = wp.uint32(four >> wp.uint64(32))
    half = wp.uint32(16)
    return wp.vec4(
        wp.cast(low << half, float),
        wp.cast((low >> half) << half, float),
        wp.cast(high << half, float),
        wp.cast((high >> half) << half, float),
    )


@wp.func
@no_type_check
def rounded(value: float) -> wp.uint32:
    """The 16 bits of the nearest bfloat16, even if two are as near."""
    bits = wp.cast(value, wp.uint32)
    return (bits + wp.uint32(0x7FFF) + ((bits >> wp.uint32(16)) & wp.uint32(1))) >> wp.uint32(16)


@wp.kernel(enable_backward=False)
@no_type_check
def filter_fours(
    start: int,
    weights: wp.array[float],
    axis: Axis,
    values: wp.array[wp.uint64],
    gate: wp.array[wp.uint64],
    result: wp.array[wp.uint64],
) -> None:
    """Compute four neighbouring outputs in bfloat16, which pass through memory as one number."""
    item = start + wp.tid()
    place = places(item, axis)
    total = wp.vec4()
    j = first_input(axis, place[1])
    tap = j * axis.up - place[1]
    while j < axis.length and tap < axis.taps:
        total += weights[axis.origin + axis.turn * tap] * as_floats(values[place[0] + j * axis.inner])
        j += 1
        tap += axis.up
    before = wp.vec4()
    if axis.finish == _GATE:
        before = as_floats(gate[item])
    found = wp.uint64(0)
    for k in range(4):
        half = rounded(finished(total[k], before[k], axis))
        found = found | (wp.uint64(half) << wp.uint64(16 * k))
    result[item] = found
