"""Rows of channels as vectors of four, for kernels that handle four channels with one instruction."""

from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation import kernels

QUAD = 4
"""Channels that kernels handle together."""


def whole_quads(features: Float[Tensor, "item channel"]) -> Float[Tensor, "item padded"]:
    """Add channels up to a multiple of `QUAD`, without a copy if they are there already.

    The added channels hold zeros or, if `features` are the first columns of a matrix of that width (`room_for_quads`),
    its other columns, which must be finite.
    """
    items, channels = features.shape
    missing = -channels % QUAD
    if not missing:
        return features
    width = channels + missing
    if torch.compiler.is_compiling():
        # A graph knows nothing of the memory around a tensor.
        return torch.nn.functional.pad(features, (0, missing))
    end = features.storage_offset() + items * width
    if features.stride() == (width, 1) and end * features.element_size() <= features.untyped_storage().nbytes():
        return features.as_strided((items, width), (width, 1))
    return torch.nn.functional.pad(features, (0, missing))


def room_for_quads(items: int, channels: int, device: torch.device) -> Float[Tensor, "item padded"]:
    """Zeros, with as many channels as `whole_quads` needs."""
    return kernels.zeros((items, -(-channels // QUAD) * QUAD), torch.float32, device)


def quads(features: Float[Tensor, "item padded"]) -> Any:
    """View channels, a multiple of `QUAD`, as vectors."""
    return kernels.array(features.contiguous().view(len(features), features.shape[1] // QUAD, QUAD), wp.vec4)
