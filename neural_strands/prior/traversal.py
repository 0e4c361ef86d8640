"""Effects of latent directions on strands, and the directions that control length, curliness and bend."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import lengths
from neural_strands.prior.generator import StrandGenerator

MEASURES = ("length", "curliness", "bend")
"""Measures of a strand; see `measure`."""


@dataclass(frozen=True)
class Traversal:
    """Latent directions and their meaning.

    Attributes:
        effect_mm: mean shift of the points when one latent changes by one standard deviation, for each latent.
        correlation: correlation of each latent with each measure, over samples of N(0, I).
        direction: unit direction of each measure's linear regression.
        direction_correlation: correlation of the component along that direction with the measure.
    """

    effect_mm: Float[Tensor, " latent"]
    correlation: Float[Tensor, "latent measure"]
    direction: Float[Tensor, "measure latent"]
    direction_correlation: Float[Tensor, " measure"]


@torch.no_grad()
def traverse(generator: StrandGenerator, samples: Float[Tensor, "sample latent"]) -> Traversal:
    """Measure the effect of each latent at the given samples of N(0, I)."""
    count, size = samples.shape
    strands = generator(samples)
    effect = []
    for index in range(size):
        moved = samples.clone()
        moved[:, index] += 1
        effect.append(1000 * (generator(moved) - strands).norm(dim=-1).mean())
    values = measure(strands)
    white = samples - samples.mean(dim=0)
    centred = values - values.mean(dim=0)
    correlation = white.T @ centred / (white.norm(dim=0)[:, None] * centred.norm(dim=0)).clamp(min=1e-12)
    ridge = 1e-3 * count * torch.eye(size, dtype=samples.dtype, device=samples.device)
    slopes = torch.linalg.solve(white.T @ white + ridge, white.T @ centred).T
    direction = torch.nn.functional.normalize(slopes, dim=1)
    along = white @ direction.T
    agreement = (along * centred).sum(dim=0) / (along.norm(dim=0) * centred.norm(dim=0)).clamp(min=1e-12)
    return Traversal(torch.stack(effect), correlation, direction, agreement)


def measure(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand measure"]:
    """Logarithms of length, of curliness and of bend.

    A strand is smoothed by a moving mean over a fifth of its points. Curliness is the share of the length that
    smoothing removes; bend is the share by which the smooth curve is longer than its chord.
    """
    length = lengths(points)
    window = max(3, points.shape[1] // 5)
    smooth = torch.nn.functional.avg_pool1d(points.transpose(1, 2), window, stride=1).transpose(1, 2)
    kept = points[:, window // 2 : window // 2 + smooth.shape[1]]
    smooth_length = lengths(smooth).clamp(min=1e-9)
    curliness = (lengths(kept) / smooth_length - 1).clamp(min=1e-4)
    chord = (smooth[:, -1] - smooth[:, 0]).norm(dim=-1).clamp(min=1e-9)
    bend = (smooth_length / chord - 1).clamp(min=1e-4)
    return torch.stack([length.log(), curliness.log(), bend.log()], dim=1)
