"""Warp kernels that add or average values over the neighbours of voxels (see `flow.faces`)."""

# Warp's array types mean nothing to Python's type checkers.
# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def sum_kernel(
    start: int, values: wp.array2d[float], neighbours: wp.array2d[wp.int64], is_mean: int, found: wp.array2d[float]
) -> None:
    """Sum of the values of each cell's six neighbours, or their mean, which is the cell's own value if it has none.

    An index equal to the number of cells, where `values` has a row of zeros, means no neighbour.
    """
    i = start + wp.tid()
    a = int(neighbours[i, 0])
    b = int(neighbours[i, 1])
    c = int(neighbours[i, 2])
    d = int(neighbours[i, 3])
    e = int(neighbours[i, 4])
    f = int(neighbours[i, 5])
    share = 1.0
    if is_mean == 1:
        n = values.shape[0] - 1
        count = int(a < n) + int(b < n) + int(c < n) + int(d < n) + int(e < n) + int(f < n)
        share = float(wp.max(count, 1))
        if count == 0:
            # The sum is then its own value.
            a = i
    for channel in range(values.shape[1]):
        first = values[a, channel] + values[b, channel] + values[c, channel]
        found[i, channel] = (first + values[d, channel] + values[e, channel] + values[f, channel]) / share
