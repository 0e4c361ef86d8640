"""Depth of what a rendered picture shows, so that objects drawn by another program can be hidden behind it."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.model.compositing import REACH
from neural_strands.model.outputs import RenderOutput
from neural_strands.raster.dilation import widen

OPAQUE = 0.5
"""Opacity of hair from which a pixel counts as hair."""
ALLOWANCE = 0.003
"""Distance by which everything is pushed back, metres, so that lines on the hair and meshes on the skin are visible."""
ON_SKIN = 0.001
"""Least distance of hair in front of the skin, metres: a mesh of the skin must not cover hair that lies on it."""


def picture_depth(output: RenderOutput) -> Float[Tensor, "height width"]:
    """Depth of what each pixel shows, metres along the optical axis; infinite where there is only background.

    A pixel of hair has the depth of its nearest strand or, in a gap that the network has closed, of the nearest strand
    around it. Every other pixel has the depth of the body.

    Args:
        output: a rendered view.
    """
    factor = output.lines.depth.shape[0] // output.alpha.shape[0]
    hair = _nearest_in_pixel(output.lines.depth, factor)
    hair = torch.where(hair.isinf(), _nearest_around(hair), hair)
    skin = _nearest_in_pixel(output.body_depth, factor)
    # The farthest point of the pixel, so that a mesh of the body covers the body's picture on slopes as well.
    body = -_nearest_in_pixel(-output.body_depth, factor)
    return torch.where(output.alpha > OPAQUE, torch.minimum(hair + ALLOWANCE, skin - ON_SKIN), body + ALLOWANCE)


def _nearest_in_pixel(depth: Float[Tensor, "fine_height fine_width"], factor: int) -> Float[Tensor, "height width"]:
    """Least depth in squares of `factor` x `factor` samples."""
    rows = depth.unflatten(0, (-1, factor)).amin(dim=1)
    return rows.unflatten(1, (-1, factor)).amin(dim=2)


def _nearest_around(depth: Float[Tensor, "height width"]) -> Float[Tensor, "height width"]:
    """Least depth up to `REACH` pixels away, along rows and columns."""
    return -widen(-depth, REACH)
