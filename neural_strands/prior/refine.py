"""Optimises latents for given strands: the best that the decoder can do."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.gradients import Adam
from neural_strands.geometry.strands import lengths, segments
from neural_strands.prior.analysis import DIRECTION_WEIGHT
from neural_strands.prior.generator import StrandGenerator


def refine_latents(
    generator: StrandGenerator,
    latent: Float[Tensor, "strand latent"],
    points: Float[Tensor, "strand point 3"],
    steps: int = 200,
    learning_rate: float = 0.01,
) -> Float[Tensor, "strand latent"]:
    """Run Adam on each strand's latent, with a learning rate that falls to zero, and return the best latents.

    Args:
        generator: the decoder.
        latent: initial latents.
        points: the strands to match, local metres.
        steps: number of steps.
        learning_rate: initial learning rate.
    """
    current = latent.detach().clone().requires_grad_(True)
    optimiser = Adam([current], learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    scale = lengths(points)[:, None, None]
    best, lowest = latent.detach().clone(), latent.new_full((len(latent),), torch.inf)
    for _ in range(steps):
        error = (generator(current, points.shape[1]) - points) / scale
        slope = segments(error) * (points.shape[1] - 1)
        loss = error.square().sum(dim=(1, 2)) + DIRECTION_WEIGHT**2 * slope.square().sum(dim=(1, 2))
        with torch.no_grad():
            better = loss < lowest
            lowest = torch.where(better, loss, lowest)
            best = torch.where(better[:, None], current, best)
        optimiser.zero_grad()
        # The square root makes strands with large and small errors move at the same pace; each has its own latent.
        (loss + 1e-12).sqrt().sum().backward()
        optimiser.step()
        schedule.step()
    return best.detach()
