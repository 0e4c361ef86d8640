"""Decodes strands in blocks that stay in the processor's cache.

Strands are decoded independently, so blocks give the same values and gradients as decoding all at once
(`StrandGenerator.reference`, against which this is tested). They only keep the sines of a block in the cache.
"""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

BLOCK = 2048
"""Strands per block on a CPU."""


def in_blocks(
    decode: Callable[[Tensor, int], Tensor], latent: Float[Tensor, "strand latent"], points: int
) -> Float[Tensor, "strand {points} 3"]:
    """Decode in blocks on the CPU, and all at once on other devices."""
    if latent.device.type != "cpu" or len(latent) <= BLOCK:
        return decode(latent, points)
    if torch.is_grad_enabled():
        return torch.cat([decode(block, points) for block in latent.split(BLOCK)])
    strands = latent.new_zeros(len(latent), points, 3)
    for source, target in zip(latent.split(BLOCK), strands.split(BLOCK), strict=True):
        target.copy_(decode(source, points))
    return strands
