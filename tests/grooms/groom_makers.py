"""Grooms for the tests of readers and writers."""

import torch

from neural_strands.grooms.groom import Groom


def make_groom(sizes: list[int], seed: int = 0) -> Groom:
    """A groom with every attribute; widths and colours are such that every format can hold them."""
    generator = torch.Generator().manual_seed(seed)
    strands, total = len(sizes), sum(sizes)
    counts = torch.tensor(sizes)
    width = 1e-4 * (1 + torch.rand(strands, generator=generator))
    return Groom(
        vertices=torch.randn(total, 3, generator=generator),
        offsets=torch.cat([torch.zeros(1, dtype=torch.int64), counts.cumsum(0)]),
        root_uv=torch.rand(strands, 2, generator=generator),
        root_normal=torch.nn.functional.normalize(torch.randn(strands, 3, generator=generator), dim=1),
        width=width.repeat_interleave(counts),
        color=torch.rand(strands, 3, generator=generator),
        unseen=torch.rand(strands, generator=generator),
        t=torch.cat([0.7 * torch.linspace(0, 1, size) for size in sizes]),
    )
