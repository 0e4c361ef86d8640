"""PSNR of hair at the photograph's exposure, so that a phone's automatic exposure does not count as an error."""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.evaluation.image_metrics import psnr
from neural_strands.evaluation.view_quality import RenderedView
from neural_strands.foundation.srgb import to_linear, to_srgb

NO_HAIR = 0.02
"""Coverage up to which a pixel shows no hair."""
CLIPPED = 0.98
"""Encoded value above which a sample may be clipped and is not used to estimate exposure."""
FEWEST_PIXELS = 100
"""Fewest pixels from which exposure is estimated; with fewer, the gain is 1."""


def matching_gain(
    rendered: Float[Tensor, "height width 3"],
    photograph: Float[Tensor, "height width 3"],
    region: Bool[Tensor, "height width"],
) -> Float[Tensor, "3"]:
    """Estimate the gain, for each linear channel, that makes a rendering as bright as a photograph in a region.

    Args:
        rendered: sRGB in [0, 1].
        photograph: sRGB in [0, 1].
        region: where to compare; pixels that are clipped in either picture are left out.
    """
    usable = region & (torch.maximum(rendered, photograph) < CLIPPED).all(dim=-1)
    if int(usable.sum()) < FEWEST_PIXELS:
        return rendered.new_ones(3)
    mine, theirs = (to_linear(picture[usable]).mean(dim=0) for picture in (rendered, photograph))
    return theirs.clamp(min=1e-6) / mine.clamp(min=1e-6)


@torch.no_grad()
def matched_psnr(view: RenderedView) -> float | None:
    """PSNR over the hair, dB, after a gain per channel that matches the brightness of everything that is not hair.

    Scored pixels are not used to estimate the gain. None for a view without hair or without a mask.
    """
    region = view.hair_region()
    if view.mask is None or not bool(region.any()):
        return None
    gain = matching_gain(view.rendered, view.photograph, view.mask <= NO_HAIR)
    rendered = to_srgb(to_linear(view.rendered) * gain).clamp(0, 1)
    return float(psnr(rendered, view.photograph, region.to(rendered)))


def mean_matched_psnr(views: Sequence[RenderedView]) -> float | None:
    """Mean over the views that have hair and a mask; None if there are none."""
    found = [value for value in map(matched_psnr, views) if value is not None]
    return sum(found) / len(found) if found else None
