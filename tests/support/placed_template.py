"""The built-in template as a head that was placed on a person."""

import torch

from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.scalp.fit_similarity import Similarity


def placed_template() -> FittedHead:
    """The template where it stands, without figures; cameras and world have the same frame."""
    template = builtin_template()
    frame = Similarity(1.0, torch.eye(3).double(), torch.zeros(3).double())
    return FittedHead(template.head, template.landmarks, frame, {})
