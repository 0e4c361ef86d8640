"""Hair of a photograph that no strand reaches, from which the image generator must not learn."""

from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.fitting.photographs.surround_weights import BESIDE
from neural_strands.model.compositing import REACH
from neural_strands.raster.dilation import widen

COVERED = 0.01
"""Coverage above which strands reach a pixel; with less, rounding would decide."""


def unreached_hair(
    reference: Float[Tensor, "height width"], coverage: Float[Tensor, "height width"]
) -> Bool[Tensor, "height width"]:
    """Find pixels of hair that are too far from all strands for the image generator to add hair there.

    A generator that learned from them would draw hair where there is none: beside all strands, in every view.

    Args:
        reference: opacity of the photograph's hair.
        coverage: of each pixel by strands.
    """
    return (reference > BESIDE) & (widen(coverage.detach(), REACH) <= COVERED)
