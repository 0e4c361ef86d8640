"""Depth keys (see `keys`) as Warp kernels write and read them: depth bits above, index bits below.

Warp compiles these functions from their source. Its array types mean nothing to Python's type checkers, so the code is
not type-checked.
"""

# pyright: reportIndexIssue=false, reportArgumentType=false, reportOperatorIssue=false, reportCallIssue=false

from typing import no_type_check

import warp as wp

from neural_strands.raster.keys import NO_PRIMITIVE

_NO_PRIMITIVE = wp.constant(NO_PRIMITIVE)
NOT_DRAWN = wp.constant(0x7FFFFFFF)
"""Depth bits greater than those of any depth; a key with these replaces no other."""


@wp.func
@no_type_check
def make_key(depth: float, index: int) -> wp.int64:
    """Join a depth (metres, at least 0) and a primitive's index."""
    return key_of_bits(wp.cast(depth, wp.int32), index)


@wp.func
@no_type_check
def key_of_bits(depth: int, index: int) -> wp.int64:
    """Join the bits of a depth and a primitive's index."""
    return (wp.int64(depth) << wp.int64(32)) | wp.int64(index)


@wp.func
@no_type_check
def key_index(key: wp.int64) -> wp.int64:
    """The primitive of a key, -1 where nothing has been drawn."""
    index = key & wp.int64(_NO_PRIMITIVE)
    if index == wp.int64(_NO_PRIMITIVE):
        return wp.int64(-1)
    return index


@wp.func
@no_type_check
def key_depth(key: wp.int64) -> float:
    """The depth of a key, metres."""
    return wp.cast(wp.int32(key >> wp.int64(32)), wp.float32)


@wp.kernel(enable_backward=False)
@no_type_check
def start_keys(occluder: wp.array[float], bias: float, keys: wp.array[wp.int64]) -> None:
    """Initialise one pixel's key to the depth of the occluder plus its bias; an empty occluder hides nothing."""
    pixel = wp.tid()
    depth = wp.float32(wp.inf)
    if occluder.shape[0] > 0:
        depth = occluder[pixel] + bias
    keys[pixel] = (wp.int64(wp.cast(depth, wp.int32)) << wp.int64(32)) | wp.int64(_NO_PRIMITIVE)
