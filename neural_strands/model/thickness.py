"""Thickness of strands as a model draws them."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.strands import Strands
from neural_strands.model.hair_model import HairModel

HAIR_WIDTH = 7e-5
"""Thickness of strands whose width the fit did not estimate, metres: that of a typical human hair."""


@torch.no_grad()
def strand_widths(model: HairModel, strands: Strands) -> Float[Tensor, "strand point"]:
    """Thickness of every point, metres; an exported groom then covers the same pixels as the model's own strands."""
    along = strands.parameters()
    tip = torch.ones_like(along) if model.lines.tip <= 0 else ((1 - along) / model.lines.tip).clamp(max=1.0)
    return model.lines.width * tip if model.lines.width > 0 else torch.full_like(along, HAIR_WIDTH)
