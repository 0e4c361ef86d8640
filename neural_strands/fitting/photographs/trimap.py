"""Reference alpha maps: certain hair, certain background, and an unsupervised band between (paper, "Alpha Loss")."""

from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.geometry.rectangle import Rectangle
from neural_strands.raster.dilation import dilate


@dataclass(frozen=True)
class TrimapConfig:
    """Sizes of the morphological steps, for an image of any size."""

    dilation: Annotated[float, Between(0, 1)] = 0.008
    """Radius by which the mask grows before what lies outside counts as empty, as a fraction of the diagonal."""
    erosion: Annotated[float, Between(0, 1)] = 0.012
    """Radius by which the grown mask shrinks before what is left counts as opaque, as a fraction of the diagonal."""
    mattes: bool = True
    """Whether hair masks are mattes, which give the share of each pixel that is hair; otherwise trimaps are made from
    them."""


@dataclass(frozen=True)
class Trimap:
    """Reference alpha, and where it is supervised.

    Attributes:
        alpha: 1 in the interior, 0 elsewhere; or a matte.
        supervised: the interior and the exterior, but not the band between them; for a matte, every pixel.
    """

    alpha: Float[Tensor, "height width"]
    supervised: Bool[Tensor, "height width"]


def reference_alpha(mask: Float[Tensor, "height width"], place: Rectangle, config: TrimapConfig) -> Trimap:
    """Reference alpha for a part of a view with a hair mask."""
    if not config.mattes:
        return trimap_of_part(mask > 0.5, place, config)
    matte = place.of(mask)
    return Trimap(matte, torch.ones_like(matte, dtype=torch.bool))


def trimap_of_part(lines: Bool[Tensor, "height width"], place: Rectangle, config: TrimapConfig | None = None) -> Trimap:
    """Dilate the rasterised segments, then erode: outside the dilated mask is empty, inside the eroded one opaque.

    Only the given part of the image is computed, from that part and as much around it as the discs reach.
    """
    config = config or TrimapConfig()
    diagonal = (lines.shape[0] ** 2 + lines.shape[1] ** 2) ** 0.5
    grow, shrink = round(config.dilation * diagonal), round(config.erosion * diagonal)
    first, second = max(grow // 2, 1), grow // 2 + shrink
    around = max(grow, first + second)
    top, left = max(place.top - around, 0), max(place.left - around, 0)
    lines = lines[top : place.top + place.height + around, left : place.left + place.width + around]
    covered = dilate(lines, grow)
    interior = ~dilate(~dilate(lines, first), second)
    part = Rectangle(place.left - left, place.top - top, place.width, place.height).of
    return Trimap(part(interior).to(torch.float32), part(interior | ~covered))
