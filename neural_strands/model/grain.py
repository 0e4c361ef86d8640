"""Grain: noise over the hair like that of the photographs, which a fit learns apart from the hair.

Photographs have noise: a camera's, or that of a path tracer. LPIPS tells a noisy photograph from a clean picture, so
an image generator that is trained with it imitates noise by a weave over the strands. Therefore LPIPS compares pictures
with grain, and the squared error compares pictures without it. People see none, unless they ask for it.

As in film grain synthesis for video (Norkin and Birkbeck 2018), the strength of the grain is a curve over the
brightness of the picture below it.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from neural_strands.raster.gaussian_blur import gaussian_blur
from neural_strands.raster.noise import normal_noise

KNOTS = 5
"""Brightnesses, from black to white, at which the strength of the grain is learned."""
SCALE = 0.05
"""Amplitude of the grain, in encoded colours, where the softplus of what is learned is 1."""
SOFT = 0.8
"""Standard deviation, in pixels, of the blur of the softer of two kinds of noise; the other is white."""
REACH = 3
"""Pixels on each side that this blur reads."""


class Grain(nn.Module):
    """Strength of grain: white and soft, grey and coloured, each a curve over brightness."""

    def __init__(self) -> None:
        super().__init__()
        # Brightnesses that no pixel has follow the others through `level`.
        self.level = nn.Parameter(torch.zeros(2, 2, 1))
        self.curve = nn.Parameter(torch.zeros(2, 2, KNOTS))

    def amplitudes(self) -> Float[Tensor, "softness=2 colour=2 knot"]:
        """Standard deviation of the grain at every knot, sRGB-encoded: white then soft, grey then coloured."""
        return SCALE * functional.softplus(self.level + self.curve)

    def forward(self, rgb: Float[Tensor, "height width 3"], random: torch.Generator) -> Float[Tensor, "height width 3"]:
        """Draw grain for a picture; only the strength of the grain has a gradient.

        Args:
            rgb: sRGB-encoded.
            random: draws the seed of the noise, which is the same on every device.
        """
        height, width, _ = rgb.shape
        drawn = normal_noise((2, 4, height + 2 * REACH, width + 2 * REACH), random, rgb.device)
        inner = slice(REACH, -REACH)
        # A Gaussian takes white noise to a variance of 1 / (4 pi SOFT^2).
        soft = 2 * math.sqrt(math.pi) * SOFT * gaussian_blur(drawn[1], SOFT)
        noise = torch.stack([drawn[0], soft])[..., inner, inner].to(rgb)
        place = rgb.detach().mean(dim=2, keepdim=True).clamp(0, 1) * (KNOTS - 1)
        # Linear interpolation as a product: the gradient of a gather would be a sum in no fixed order.
        share = (1 - (place - torch.arange(KNOTS, device=rgb.device)).abs()).clamp(min=0)
        grey, coloured = torch.einsum("hwk,sck->schw", share, self.amplitudes()).unbind(dim=1)
        return (grey[:, None] * noise[:, :1] + coloured[:, None] * noise[:, 1:]).sum(dim=0).permute(1, 2, 0)
