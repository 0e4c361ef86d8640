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

CPU_BATCH = 4096
"""Points that the CPU shades together: what lies between two layers stays in its cache."""


@dataclass(frozen=True)
class ShadingConfig:
    """Size of the point shader."""

    hidden: int = 64
    """Width of its hidden layers; 0 leaves a linear decode."""
    layers: int = 2
    """Hidden layers."""


class PointShading(nn.Module):
    """A linear decode of z_a plus a small network of z_a, direction, t, viewing direction and the angle of the two."""

    def __init__(self, features: int, config: ShadingConfig, generator: torch.Generator) -> None:
        """Start from a random linear decode; the network starts at zero.

        Args:
            features: size of z_a.
            config: size of the network.
            generator: draws the first weights.
        """
        super().__init__()
        self.decode = nn.Parameter(torch.randn(3, features, generator=generator) / features**0.5)
        self.mean = nn.Parameter(torch.zeros(3))
        hidden = config.hidden if config.layers else 0
        inputs = [features + 3 + 1 + 3 + 2, *([hidden] * (config.layers - 1))] if hidden else []
        self.inner = nn.ParameterList(torch.randn(hidden, size, generator=generator) / size**0.5 for size in inputs)
        self.biases = nn.ParameterList(torch.zeros(hidden) for _ in inputs)
        self.outer = nn.Parameter(torch.zeros(3 * (1 + features), hidden))

    def forward(
        self, descriptor: Float[Tensor, "point descriptor"], view: Float[Tensor, "point 3"]
    ) -> Float[Tensor, "point 3"]:
        """Colour of points from their descriptor [z_a, d, t] and the unit direction in which they are seen."""
        if not len(self.inner):
            return F.linear(descriptor[:, : self.decode.shape[1]], self.decode, self.mean)
        if descriptor.device.type != "cpu":
            return self._shade(descriptor, view)
        batches = zip(descriptor.split(CPU_BATCH), view.split(CPU_BATCH), strict=True)
        return torch.cat([self._shade(*batch) for batch in batches])

    def _shade(
        self, descriptor: Float[Tensor, "point descriptor"], view: Float[Tensor, "point 3"]
    ) -> Float[Tensor, "point 3"]:
        features = self.decode.shape[1]
        # Reflection off a fibre depends on the angle between fibre and ray before all else.
        along = (descriptor[:, features : features + 3] * view).sum(dim=1, keepdim=True)
        hidden = torch.cat([descriptor, view, along, 1 - along.square()], dim=1)
        for weight, bias in zip(self.inner, self.biases, strict=True):
            hidden = F.silu(F.linear(hidden, weight, bias))
        # Light that reaches a point is its own; how a fibre sends it on depends on direction and view alone. The
        # linear decode is what it sends on whatever the direction: a bias.
        decode = torch.cat([self.mean[:, None], self.decode], dim=1).flatten()
        response = F.linear(hidden, self.outer, decode).unflatten(1, (3, 1 + features))
        own = descriptor[:, :features, None]
        return torch.baddbmm(response[:, :, :1], response[:, :, 1:], own).squeeze(2)
