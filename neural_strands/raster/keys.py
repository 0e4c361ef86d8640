"""Depth keys: 64 bits a pixel, the depth's float bits above, the primitive's index below.

The bits of positive floats are ordered as the floats are, so the minimum of keys is the nearest primitive (of two at
one depth, the one of lower index): the same in whatever order it is taken.
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor

NO_PRIMITIVE = 0xFFFFFFFF
"""Index bits of a pixel that nothing has been drawn to."""


def background_keys(depth: Float[Tensor, "height width"]) -> Int64[Tensor, "height width"]:
    """Keys that only primitives nearer than `depth` can beat (metres, at least 0; infinite where there is nothing)."""
    return (depth.float().contiguous().view(torch.int32).long() << 32) | NO_PRIMITIVE


def empty_keys(height: int, width: int, device: torch.device) -> Int64[Tensor, "height width"]:
    """Keys that any primitive beats."""
    return torch.full((height, width), (0x7F800000 << 32) | NO_PRIMITIVE, dtype=torch.int64, device=device)


def pack_keys(depth: Float[Tensor, " n"], index: Int64[Tensor, " n"]) -> Int64[Tensor, " n"]:
    """Join depths (metres) and indices into keys."""
    return (depth.float().contiguous().view(torch.int32).long() << 32) | index


def key_index(keys: Int64[Tensor, "*batch"]) -> Int64[Tensor, "*batch"]:
    """The nearest primitive of each pixel, -1 where there is none."""
    index = keys & NO_PRIMITIVE
    return torch.where(index == NO_PRIMITIVE, -1, index)
