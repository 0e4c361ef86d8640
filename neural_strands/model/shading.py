"""Colour of points of strands, before they are blended into pixels.

A pixel covers several hairs. A camera sees the blend of their individual colours, so points are shaded before they are
blended. The image generator, which sees the blended descriptors, then corrects for the effect of neighbours on each
other. The paper leaves all of it to the generator.

The light that reaches a point is specific to the point: z_a. How a fibre scatters it is one function for all fibres, of
the angles between fibre, eye and lights (Marschner et al., "Light Scattering from Human Hair Fibers", 2003) and of the
hair around it (`model.hair_volume`), so that what is learned from one strand applies to others. A function that also
saw z_a would memorise each strand's training views.
"""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from neural_strands.foundation.configs import Between
from neural_strands.geometry.rays import spread_directions
from neural_strands.model import hair_volume

CPU_BATCH = 16384
"""Points per batch on the CPU: few enough for its cache, and enough for two threads to share each operation."""

LOBE = 0.25
"""Width of the highlight among the network's inputs, in units of the sum of both inclinations' sines."""

ANGLES = 4
"""Number of inputs that describe a fibre relative to one light and the eye."""


@dataclass(frozen=True)
class ShadingConfig:
    """Size of the point shader."""

    hidden: Annotated[int, Between(0, 1024)] = 64
    """Width of the hidden layers."""
    layers: Annotated[int, Between(0, 32)] = 2
    """Hidden layers."""
    lights: Annotated[int, Between(0, 64)] = 6
    """Number of learned light directions."""


class PointShading(nn.Module):
    """A decode that is linear in z_a, modulated by a small network of t, direction, viewing direction and lights."""

    def __init__(self, features: int, config: ShadingConfig, generator: torch.Generator) -> None:
        """Start from a random decode that is independent of direction, with lights spread over the sphere.

        Args:
            features: size of z_a.
            config: size of the network.
            generator: draws the initial weights.
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
        own: Float[Tensor, "point feature"],
        fibre: Float[Tensor, "point 4"],
        view: Float[Tensor, "point 3"],
        around: Float[Tensor, "point channel"],
    ) -> Float[Tensor, "point 3"]:
        """Colour of points, sRGB-encoded, so that equal changes are about equally visible in dark and fair hair.

        Args:
            own: z_a.
            fibre: unit direction of growth, then t.
            view: unit direction from the eye to the point.
            around: the hair around it, from `HairVolume.at`.
        """
        if not len(self.inner):
            return F.linear(own, self.decode, self.mean)
        if own.device.type != "cpu":
            return self._shade(own, fibre, view, around)
        batches = zip(*(values.split(CPU_BATCH) for values in (own, fibre, view, around)), strict=True)
        return torch.cat([self._shade(*batch) for batch in batches])

    def _shade(
        self,
        own: Float[Tensor, "point feature"],
        fibre: Float[Tensor, "point 4"],
        view: Float[Tensor, "point 3"],
        around: Float[Tensor, "point channel"],
    ) -> Float[Tensor, "point 3"]:
        lights, outward = F.normalize(self.lights, dim=1), around[:, :3]
        angles = fibre_angles(fibre[:, :3], view, lights)
        facing = (outward * view).sum(dim=1, keepdim=True)
        hidden = torch.cat([fibre, view, angles, around, facing, outward @ lights.T], dim=1)
        for weight, bias in zip(self.inner, self.biases, strict=True):
            hidden = F.silu(F.linear(hidden, weight, bias))
        # The linear decode is the part of the response that is independent of direction: a bias.
        decode = torch.cat([self.mean[:, None], self.decode], dim=1).flatten()
        response = F.linear(hidden, self.outer, decode).unflatten(1, (3, 1 + own.shape[1]))
        if own.device.type != "cpu":
            # GPU libraries are slow at a separate small matrix product per point.
            return response[:, :, 0] + (response[:, :, 1:] * own[:, None]).sum(dim=2)
        return torch.baddbmm(response[:, :, :1], response[:, :, 1:], own[:, :, None]).squeeze(2)


def fibre_angles(
    fibre: Float[Tensor, "point 3"], view: Float[Tensor, "point 3"], lights: Float[Tensor, "light 3"]
) -> Float[Tensor, "point angle"]:
    """Inputs of a fibre's reflection, after Marschner et al. 2003.

    Args:
        fibre: unit directions of growth.
        view: unit directions from the eye to the points.
        lights: unit directions to the lights.

    Returns:
        Minus the sine of the eye's inclination to the fibre's normal plane, and the square of its cosine. Then, for all
        lights at a time: the sine of the light's inclination, the sum of both sines (0 for mirror reflection), the
        highlight around 0, and the cosine of the azimuth between light and eye.
    """
    along = (fibre * view).sum(dim=1, keepdim=True)
    across = 1 - along.square()
    sine = fibre @ lights.T
    both = sine - along
    width = (across * (1 - sine.square())).clamp(min=1e-4).sqrt()
    azimuth = (sine * along - view @ lights.T) / width
    return torch.cat([along, across, sine, both, torch.exp(-(both / LOBE).square()), azimuth], dim=1)
