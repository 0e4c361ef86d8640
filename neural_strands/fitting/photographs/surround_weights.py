"""Weights of pixels in learning the colours of body and background, for photographs with person masks."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.views import View
from neural_strands.model.compositing import SurroundWeights

BESIDE = 0.1
"""Coverage by hair or person up to which a pixel counts as background; more would mix their colours into it."""


def surround_weights(view: View, hair: Float[Tensor, "height width"] | None = None) -> SurroundWeights | None:
    """Weight of each pixel in learning body and background; None for a view without a person mask.

    The background learns from pixels of neither hair nor person; body colours learn nothing where the mesh extends
    beyond both. The body also learns from the pixels of hair in front of it: skin that stayed bright there would shine
    through the hair.

    Args:
        view: a photograph with its masks.
        hair: coverage of hair; by default the view's hair mask, or none if it has no mask.
    """
    person = view.person_mask
    if person is None:
        return None
    hair = view.hair_mask if hair is None else hair
    hair = torch.zeros_like(person) if hair is None else hair
    covered = torch.maximum(person, hair)
    return SurroundWeights(covered, torch.where(covered < BESIDE, 1 - covered, 0.0))
