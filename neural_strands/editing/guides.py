"""Chooses guides: strands that represent those around them."""

import torch
from jaxtyping import Float, Int64
from torch import Tensor


def choose_guides(roots: Float[Tensor, "strand 3"], count: int) -> Int64[Tensor, " guide"]:
    """Indices of strands with evenly spread roots, each the farthest from all previous ones.

    Args:
        roots: root of every strand, metres.
        count: number of guides, at most as many as there are strands.
    """
    count = min(count, len(roots))
    chosen = torch.zeros(count, dtype=torch.int64, device=roots.device)
    gap = roots.new_full((len(roots),), torch.inf)
    for k in range(1, count):
        gap = torch.minimum(gap, (roots - roots[chosen[k - 1]]).square().sum(dim=1))
        chosen[k] = gap.argmax()
    return chosen
