"""Weights of pixels in learning the colours of body and background, for photographs with person masks."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.views import View

BESIDE = 0.1
"""Coverage by hair or person up to which a pixel counts as background; more would mix their colours into it."""


@dataclass(frozen=True)
class SurroundWeights:
    """Weight of each pixel of a photograph in learning what lies behind the hair, in [0, 1].

    Attributes:
        body: weight for the colours of the body.
        background: weight for the colours of the background.
    """

    body: Float[Tensor, "height width"]
    background: Float[Tensor, "height width"]


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
