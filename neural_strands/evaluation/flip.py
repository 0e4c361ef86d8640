"""FLIP: the difference a person sees when two images alternate on a screen (Andersson et al. 2020).

The authors' own program computes it, for a viewer at the usual distance (67 pixels per degree). Unlike LPIPS, it is not
similar to any loss of the fit.
"""

import flip_evaluator
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.evaluation.image_metrics import masked_mean


@torch.no_grad()
def flip(
    image: Float[Tensor, "height width 3"],
    reference: Float[Tensor, "height width 3"],
    mask: Float[Tensor, "height width"] | None = None,
) -> float:
    """Mean FLIP error, 0 for equal images and 1 for the most different; a mask weights the error of each pixel.

    Args:
        image: sRGB in [0, 1].
        reference: sRGB in [0, 1].
        mask: weights, by default equal; an empty one gives NaN.
    """
    shown, true = (values.detach().clamp(0, 1).float().cpu().numpy() for values in (image, reference))
    errors, _, _ = flip_evaluator.evaluate(true, shown, "LDR", applyMagma=False, computeMeanError=False)
    return float(masked_mean(torch.from_numpy(errors[..., 0]), None if mask is None else mask.cpu()))
