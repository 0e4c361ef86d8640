"""The kernel that grows a mask by a disc.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def grow_by_disc(
    start: int,
    before: wp.array2d[int],
    reach: wp.array[int],
    radius: int,
    grown: wp.array2d[wp.uint8],
) -> None:
    """Whether the disc around a pixel meets the mask.

    `before[row, column]` is the number of the mask's pixels in a row that lie before a column, `reach[k]` half the
    width of the disc in its row k.
    """
    item = start + wp.tid()
    height, width = before.shape[0], before.shape[1] - 1
    row = item // width
    column = item - row * width
    # From the middle outwards, where the disc is widest.
    for step in range(radius + 1):
        half = reach[radius + step]
        left = wp.max(column - half, 0)
        right = wp.min(column + half + 1, width)
        for side in range(2):
            here = row + step
            if side == 1:
                here = row - step
            if here >= 0 and here < height and before[here, right] > before[here, left]:
                grown[row, column] = wp.uint8(1)
                return
