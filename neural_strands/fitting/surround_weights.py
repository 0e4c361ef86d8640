"""Which pixels teach the colours of body and background, in photographs with masks of the person."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.views import View
from neural_strands.model.compositing import SurroundWeights

BESIDE = 0.1
"""Coverage of hair or person below which a pixel shows the background: more would mix their colours into it."""


def surround_weights(view: View, hair: Float[Tensor, "height width"] | None = None) -> SurroundWeights | None:
    """How much each pixel teaches body and background; None where the person is not known.

    What is neither hair nor person shows the background; where the mesh reaches beyond both, its colours learn nothing.
    Hair teaches the body behind it too: skin that stayed bright there would shine through.

    Args:
        view: a photograph with its masks.
        hair: coverage of hair; by default that of the view's mask, or none where there is no mask.
    """
    person = view.person_mask
    if person is None:
        return None
    hair = view.hair_mask if hair is None else hair
    hair = torch.zeros_like(person) if hair is None else hair
    covered = torch.maximum(person, hair)
    return SurroundWeights(covered, torch.where(covered < BESIDE, 1 - covered, 0.0))
