"""Image quality of a hair model on views that it never saw, in the hair region (paper, table 2)."""

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.evaluation.image_metrics import psnr, ssim
from neural_strands.evaluation.lpips import Lpips
from neural_strands.foundation.precision import exact_convolutions
from neural_strands.geometry.cameras import Camera
from neural_strands.model.renderer import HairRenderer

HAIR_COVERAGE = 0.5
"""Coverage from which a pixel belongs to the hair region."""


@dataclass(frozen=True)
class ViewQuality:
    """One view.

    Attributes:
        name: what the capture calls it.
        psnr: dB.
        ssim: mean structural similarity.
        lpips: perceptual distance; None where its weights are absent.
        rendered: what the model shows, sRGB in [0, 1].
        alpha: the model's opacity of the hair.
        truth: the photograph.
    """

    name: str
    psnr: float
    ssim: float
    lpips: float | None
    rendered: Float[Tensor, "height width 3"]
    alpha: Float[Tensor, "height width"]
    truth: Float[Tensor, "height width 3"]


@torch.no_grad()
def view_qualities(
    renderer: HairRenderer,
    views: Iterable[tuple[Camera, Float[Tensor, "height width 3"], Float[Tensor, "height width"] | None]],
    metric: Lpips | None,
) -> list[ViewQuality]:
    """Render each view and compare it with its photograph.

    Args:
        renderer: a model and its strands.
        views: camera, photograph and hair coverage; without one, the region is where the model sees hair.
        metric: LPIPS, if there is one.
    """
    results = []
    for camera, image, mask in views:
        output = renderer.render(camera)
        shown = output.rgb.clamp(0, 1)
        region = ((output.alpha if mask is None else mask) >= HAIR_COVERAGE).to(shown)
        with exact_convolutions():
            distance = None if metric is None else float(metric(shown, image, region))
        quality = (float(psnr(shown, image, region)), float(ssim(shown, image, region)))
        results.append(ViewQuality(camera.name, *quality, distance, shown.cpu(), output.alpha.cpu(), image.cpu()))
    return results
