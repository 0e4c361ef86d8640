"""The kernel of random numbers.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false

from typing import no_type_check

import warp as wp


@wp.kernel(enable_backward=False)
@no_type_check
def draw_normal(start: int, seed: int, values: wp.array[float]) -> None:
    """Draw one number from the normal distribution; it depends on the seed and its place alone."""
    item = start + wp.tid()
    values[item] = wp.randn(wp.rand_init(seed, item))
