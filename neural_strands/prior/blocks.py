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


def in_blocks(
    decode: Callable[..., Tensor], weights: tuple[Tensor, ...], points: int
) -> Float[Tensor, "strand {points} 3"]:
    """Decode in blocks on the CPU; all at once on other devices, and with gradients, where blocks gain nothing.

    Args:
        decode: gives strands for rows of the weights.
        weights: tensors with one row per strand.
        points: points per strand.
    """
    strands = len(weights[0])
    if weights[0].device.type != "cpu" or strands <= BLOCK or torch.is_grad_enabled():
        return decode(*weights)
    # Coordinate by coordinate in memory, as they are computed: to write points would take several times as long.
    decoded = weights[0].new_empty(strands, 3, points).mT
    blocks = zip(*(each.split(BLOCK) for each in weights), decoded.split(BLOCK), strict=True)
    for *block, target in blocks:
        target.copy_(decode(*block))
    return decoded
