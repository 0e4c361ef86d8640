"""Melanin of single strands and the colour that results."""

import math

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.synthesis.styles import Melanin

EUMELANIN_ABSORPTION = (0.419, 0.697, 1.37)
PHEOMELANIN_ABSORPTION = (0.187, 0.4, 1.05)
"""Absorption per unit of concentration for red, green, blue (d'Eon et al. 2011, section 6.1)."""
AZIMUTHAL_ROUGHNESS = 0.65
"""Roughness around the strand (0 to 1), which sets how absorption becomes colour."""


def draw_melanin(melanin: Melanin, count: int, generator: torch.Generator) -> Float[Tensor, "{count} 2"]:
    """Eumelanin and pheomelanin of each strand, log-normal around the means of the style."""
    noise = torch.randn(count, 2, generator=generator, device=generator.device)
    mean = torch.tensor([melanin.eumelanin, melanin.pheomelanin], device=generator.device)
    return mean * torch.exp(melanin.variation * noise - melanin.variation**2 / 2)


def melanin_colour(melanin: Float[Tensor, "strand 2"]) -> Float[Tensor, "strand 3"]:
    """Linear RGB of a mass of such strands (Chiang et al. 2016, section 4.2, from absorption to colour)."""
    absorption = melanin @ melanin.new_tensor([EUMELANIN_ABSORPTION, PHEOMELANIN_ABSORPTION])
    b = AZIMUTHAL_ROUGHNESS
    width = 5.969 - 0.215 * b + 2.532 * b**2 - 10.73 * b**3 + 5.574 * b**4 + 0.245 * b**5
    return torch.exp(-absorption.sqrt() * width)


def melanin_groups(
    melanin: Float[Tensor, "strand 2"], count: int
) -> list[tuple[Int64[Tensor, " member"], Float[Tensor, "2"]]]:
    """Split strands into at most `count` groups of similar pigment; returns members and mean concentrations of each.

    A renderer takes one material per shape, so a group shares one pigment.
    """
    order = melanin.sum(dim=-1).argsort()
    share = math.ceil(len(order) / count)
    return [(members, melanin[members].mean(dim=0)) for members in order.split(max(share, 1))]
