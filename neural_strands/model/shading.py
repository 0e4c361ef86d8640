"""Colour of each visible point of a strand, before points are blended into pixels.

A pixel covers several hairs. Shading them one by one and blending the colours is what a camera does; the image
generator, which sees the blended descriptors, then corrects for what neighbours do to each other. The paper leaves all
of it to the generator. Not measured apart yet.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F


@dataclass(frozen=True)
class ShadingConfig:
    """Size of the point shader."""

    hidden: int = 32
    """Width of its one hidden layer; 0 leaves a linear decode."""


class PointShading(nn.Module):
    """A linear decode of z_a plus a small network of z_a, direction, t and viewing direction."""

    def __init__(self, features: int, config: ShadingConfig, generator: torch.Generator) -> None:
        """Start from a random linear decode; the network starts at zero.

        Args:
            features: size of z_a.
            config: size of the network.
            generator: draws the first weights.
        """
        super().__init__()
        inputs, hidden = features + 3 + 1 + 3, config.hidden
        self.decode = nn.Parameter(torch.randn(3, features, generator=generator) / features**0.5)
        self.mean = nn.Parameter(torch.zeros(3))
        self.inner = nn.Parameter(torch.randn(hidden, inputs, generator=generator) / inputs**0.5)
        self.inner_bias = nn.Parameter(torch.zeros(hidden))
        self.outer = nn.Parameter(torch.zeros(3, hidden))

    def forward(
        self, descriptor: Float[Tensor, "point descriptor"], view: Float[Tensor, "point 3"]
    ) -> Float[Tensor, "point 3"]:
        """Colour of points from their descriptor [z_a, d, t] and the unit direction in which they are seen."""
        linear = F.linear(descriptor[:, : self.decode.shape[1]], self.decode, self.mean)
        if not len(self.inner):
            return linear
        hidden = F.silu(F.linear(torch.cat([descriptor, view], dim=1), self.inner, self.inner_bias))
        return linear + F.linear(hidden, self.outer)
