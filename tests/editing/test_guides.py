"""Guides spread over the scalp."""

import torch
from scipy.spatial import KDTree

from neural_strands.editing.guides import choose_guides


def test_guides_are_spread(generator):
    roots = torch.rand(2000, 3, generator=generator) * torch.tensor([0.1, 0.1, 0.0])
    chosen = choose_guides(roots, 100)
    assert len(set(chosen.tolist())) == 100
    away = KDTree(roots[chosen].numpy()).query(roots[chosen].numpy(), k=2)[0][:, 1]
    # Farthest points lie at least as far from each other as any root from its nearest guide.
    reach = KDTree(roots[chosen].numpy()).query(roots.numpy())[0].max()
    assert away.min() >= reach - 1e-6
    assert len(choose_guides(roots[:30], 100)) == 30
