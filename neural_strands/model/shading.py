"""Colour of each visible point of a strand, before points are blended into pixels.

A pixel covers several hairs. Shading them one by one and blending the colours is what a camera does; the image
generator, which sees the blended descriptors, then corrects for what neighbours do to each other. The paper leaves all
of it to the generator.

How much light of which kind reaches a point is the point's own: z_a. How a fibre sends it on is the same function for
all fibres, of the angles between fibre, eye and lights (Marschner et al., "Light Scattering from Human Hair Fibers",
2003) and of how the hair lies about it (`model.hair_volume`): what one strand shows from one side teaches how another
will look from elsewhere. A function that saw z_a as well would learn each strand's training views by heart.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from neural_strands.foundation.configs import Between
from neural_strands.model import hair_volume

CPU_BATCH = 4096
"""Points that the CPU shades together: what lies between two layers stays in its cache."""

LOBE = 0.25
"""Width of the highlight that the network is given, in the sum of the sines of both inclinations."""

ANGLES = 4
"""Numbers that describe how a fibre lies to one light and to the eye."""


@dataclass(frozen=True)
class ShadingConfig:
    """Size of the point shader."""

    hidden: Annotated[int, Between(0, 1024)] = 64
    """Width of its hidden layers; 0 leaves a linear decode."""
    layers: Annotated[int, Between(0, 32)] = 2
    """Hidden layers."""
    lights: Annotated[int, Between(0, 64)] = 6
    """Directions, learned, that light is taken to come from."""


class PointShading(nn.Module):
    """A decode of z_a, linear in it, that a small network of t, direction, viewing direction and lights changes."""

    def __init__(self, features: int, config: ShadingConfig, generator: torch.Generator) -> None:
        """Start from a random decode that depends on no direction; lights start spread over the sphere.

        Args:
            features: size of z_a.
            config: size of the network.
            generator: draws the first weights.
        """
        super().__init__()
        self.decode = nn.Parameter(torch.randn(3, features, generator=generator) / features**0.5)
        self.mean = nn.Parameter(torch.zeros(3))
        hidden = config.hidden if config.layers else 0
        around = hair_volume.CHANNELS + 1 + config.lights
        inputs = [3 + 1 + 3 + 2 + ANGLES * config.lights + around, *([hidden] * (config.layers - 1))] if hidden else []
        self.lights = nn.Parameter(spread_directions(config.lights if hidden else 0))
        self.inner = nn.ParameterList(torch.randn(hidden, size, generator=generator) / size**0.5 for size in inputs)
        self.biases = nn.ParameterList(torch.zeros(hidden) for _ in inputs)
        self.outer = nn.Parameter(torch.zeros(3 * (1 + features), hidden))

    def forward(
        self,
        descriptor: Float[Tensor, "point descriptor"],
        view: Float[Tensor, "point 3"],
        around: Float[Tensor, "point channel"],
    ) -> Float[Tensor, "point 3"]:
        """Colour of points.

        Args:
            descriptor: [z_a, d, t].
            view: unit direction in which a point is seen.
            around: how the hair lies about it, as `HairVolume.at` says.
        """
        if not len(self.inner):
            return F.linear(descriptor[:, : self.decode.shape[1]], self.decode, self.mean)
        if descriptor.device.type != "cpu":
            return self._shade(descriptor, view, around)
        batches = zip(*(values.split(CPU_BATCH) for values in (descriptor, view, around)), strict=True)
        return torch.cat([self._shade(*batch) for batch in batches])

    def _shade(
        self,
        descriptor: Float[Tensor, "point descriptor"],
        view: Float[Tensor, "point 3"],
        around: Float[Tensor, "point channel"],
    ) -> Float[Tensor, "point 3"]:
        own, fibre = descriptor.split([self.decode.shape[1], 4], dim=1)
        lights, outward = F.normalize(self.lights, dim=1), around[:, :3]
        angles = fibre_angles(fibre[:, :3], view, lights)
        facing = (outward * view).sum(dim=1, keepdim=True)
        hidden = torch.cat([fibre, view, angles, around, facing, outward @ lights.T], dim=1)
        for weight, bias in zip(self.inner, self.biases, strict=True):
            hidden = F.silu(F.linear(hidden, weight, bias))
        # The linear decode is what a fibre sends on whatever the direction: a bias.
        decode = torch.cat([self.mean[:, None], self.decode], dim=1).flatten()
        response = F.linear(hidden, self.outer, decode).unflatten(1, (3, 1 + own.shape[1]))
        return torch.baddbmm(response[:, :, :1], response[:, :, 1:], own[:, :, None]).squeeze(2)


def fibre_angles(
    fibre: Float[Tensor, "point 3"], view: Float[Tensor, "point 3"], lights: Float[Tensor, "light 3"]
) -> Float[Tensor, "point angle"]:
    """What a fibre's reflection depends on, after Marschner et al. 2003.

    Args:
        fibre: unit directions of growth.
        view: unit directions from the eye to the points.
        lights: unit directions to the lights.

    Returns:
        Minus the sine of the eye's inclination to the fibre's normal plane and the square of its cosine; then, each for
        all lights, the sine of the light's inclination, the sum of both sines (0 where the fibre reflects light to the
        eye like a mirror), the highlight about that, and the cosine of the azimuth between light and eye.
    """
    along = (fibre * view).sum(dim=1, keepdim=True)
    across = 1 - along.square()
    sine = fibre @ lights.T
    both = sine - along
    width = (across * (1 - sine.square())).clamp(min=1e-4).sqrt()
    azimuth = (sine * along - view @ lights.T) / width
    return torch.cat([along, across, sine, both, torch.exp(-(both / LOBE).square()), azimuth], dim=1)


def spread_directions(count: int) -> Float[Tensor, "count 3"]:
    """Unit directions spread evenly over the sphere: a Fibonacci lattice."""
    place = torch.arange(count) + 0.5
    height = 1 - 2 * place / max(count, 1)
    turn = place * math.pi * (1 + 5**0.5)
    across = (1 - height.square()).sqrt()
    return torch.stack([across * turn.cos(), height, across * turn.sin()], dim=1)
