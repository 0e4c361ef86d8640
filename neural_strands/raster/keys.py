"""Depth keys: 64 bits per pixel, with the depth's float bits above and the primitive's index below.

The bits of positive floats are ordered like the floats, so the minimum of keys is the nearest primitive (of two at the
same depth, the one with the lower index), in whatever order the minimum is taken.
"""

import torch
from jaxtyping import Float, Int64
from torch import Tensor

NO_PRIMITIVE = 0xFFFFFFFF
"""Index bits of a pixel to which nothing has been drawn."""


def background_keys(depth: Float[Tensor, "height width"]) -> Int64[Tensor, "height width"]:
    """Keys that only primitives nearer than `depth` replace."""
    return (depth.float().contiguous().view(torch.int32).long() << 32) | NO_PRIMITIVE


def empty_keys(height: int, width: int, device: torch.device) -> Int64[Tensor, "height width"]:
    """Keys that any primitive replaces."""
    return torch.full((height, width), (0x7F800000 << 32) | NO_PRIMITIVE, dtype=torch.int64, device=device)


def pack_keys(depth: Float[Tensor, " n"], index: Int64[Tensor, " n"]) -> Int64[Tensor, " n"]:
    """Join depths (metres) and indices into keys."""
    return (depth.float().contiguous().view(torch.int32).long() << 32) | index


def key_index(keys: Int64[Tensor, "*batch"]) -> Int64[Tensor, "*batch"]:
    """The nearest primitive of each pixel, -1 where there is none."""
    index = keys & NO_PRIMITIVE
    return torch.where(index == NO_PRIMITIVE, -1, index)
