"""Guides: strands chosen to stand for those around them, and strands that follow them."""

import torch
from jaxtyping import Float, Int64
from torch import Tensor


def choose_guides(roots: Float[Tensor, "strand 3"], count: int) -> Int64[Tensor, " guide"]:
    """Indices of strands whose roots are spread evenly: each is the one farthest from all before it.

    Args:
        roots: root of every strand, metres.
        count: how many guides, at most as many as there are strands.
    """
    count = min(count, len(roots))
    chosen = torch.zeros(count, dtype=torch.int64, device=roots.device)
    gap = roots.new_full((len(roots),), torch.inf)
    for k in range(1, count):
        gap = torch.minimum(gap, (roots - roots[chosen[k - 1]]).square().sum(dim=1))
        chosen[k] = gap.argmax()
    return chosen
