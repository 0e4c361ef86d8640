"""Optimised latents come closer than where they started."""

import torch

from neural_strands.prior.curves import synthetic_curves
from neural_strands.prior.refine import refine_latents
from neural_strands.prior.vae import load_prior


def test_optimised_latents_come_closer() -> None:
    prior = load_prior()
    curves = synthetic_curves(20, torch.Generator().manual_seed(1))
    start = prior.encode(curves) + 0.05
    better = refine_latents(prior.generator, start, curves, 30)
    before, after = ((prior.decode(z) - curves).norm(dim=-1).mean() for z in (start, better))
    assert after < 0.5 * before
    assert not better.requires_grad
