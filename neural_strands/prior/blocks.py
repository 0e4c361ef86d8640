"""Decodes strands in blocks that stay in the processor's cache.

Strands are decoded independently, so blocks give the same values as decoding all at once. They only keep the waves of a
block in the cache.
"""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

BLOCK = 512
"""Strands per block on a CPU."""


def in_blocks(decode: Callable[..., Tensor], weights: tuple[Tensor, ...]) -> Float[Tensor, "strand point 3"]:
    """Decode in blocks on the CPU; all at once on other devices, and with gradients, where blocks gain nothing.

    Args:
        decode: gives strands for rows of the weights.
        weights: tensors with one row per strand.
    """
    if weights[0].device.type != "cpu" or len(weights[0]) <= BLOCK or torch.is_grad_enabled():
        return decode(*weights)
    blocks = zip(*(each.split(BLOCK) for each in weights), strict=True)
    # Joined coordinate by coordinate, as they lie in memory: to write points would take several times as long.
    return torch.cat([decode(*block).mT for block in blocks]).mT
