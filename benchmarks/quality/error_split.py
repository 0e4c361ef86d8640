"""Splits the squared error of a rendering over the hair by place, by fineness and by brightness, without a remainder.

- Place: by the distance of a pixel to the border of the hair.
- Fineness: the difference of both pictures is cut into three bands by Gaussians within the hair, and the share of a
  band is the mean product of the difference with the band. The bands add up to the difference, so shares add up to the
  squared error; away from the border they are those of its spectrum, weighted by the bands' gains.
- Brightness: highlights are the brightest hundredth of the hair by the mean over 9 x 9 pixels. Those of the photograph
  and those that only the rendering has are told apart.
- Cause: what lies near the border is the outline's; of the rest, the coarsest band is light and colour, and what
  remains is detail.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.raster.texture import blur_texture

NEAR, FAR = 3.0, 8.0
"""Distances to the border of the hair that divide it, pixels."""
FINE, COARSE = 1.0, 4.0
"""Standard deviations of the Gaussians that divide the bands, pixels."""
SQUARE = 9
"""Side of the square over which brightness is averaged, pixels."""
BRIGHTEST = 0.01
"""Share of the hair that counts as highlights."""
UNIT = 1e-5
"""In which squared errors are given."""


@dataclass(frozen=True)
class ErrorSplit:
    """A rendering's error over the hair of one view.

    Attributes:
        total: mean squared error of a pixel and channel, in `UNIT`.
        parts: by name of the split and of the part: how much of `total` it has.
        pixels: by name of the split and of the part: percentage of the hair, for splits that divide pixels.
    """

    total: float
    parts: dict[str, dict[str, float]]
    pixels: dict[str, dict[str, float]]


def split_error(
    rendered: Float[Tensor, "height width 3"],
    photograph: Float[Tensor, "height width 3"],
    hair: Bool[Tensor, "height width"],
) -> ErrorSplit:
    """Split the squared error of a rendering over the hair.

    Args:
        rendered: sRGB in [0, 1].
        photograph: sRGB in [0, 1].
        hair: the pixels that count, at least one.
    """
    difference = rendered - photograph
    square = difference.square().mean(dim=2)
    bands = {name: (difference * band).mean(dim=2) for name, band in error_bands(difference, hair).items()}
    border, bright = by_border(hair), by_brightness(rendered, photograph, hair)
    outline = border[f"within {NEAR:g} px"]
    smooth, whole = bands[f"coarser than {COARSE:g} px"], _mean(square, hair)

    def divided(masks: dict[str, Tensor]) -> dict[str, float]:
        return {name: _mean(square * mask, hair) for name, mask in masks.items()}

    def shares(masks: dict[str, Tensor]) -> dict[str, float]:
        return {name: 100 * UNIT * _mean(mask.float(), hair) for name, mask in masks.items()}

    causes = {
        "outline": _mean(square * outline, hair),
        "light and colour": _mean(smooth * ~outline, hair),
        "detail": _mean((square - smooth) * ~outline, hair),
    }
    parts = {
        "border": divided(border),
        "fineness": {name: _mean(product, hair) for name, product in bands.items()},
        "brightness": divided(bright),
        "cause": causes,
    }
    return ErrorSplit(whole, parts, {"border": shares(border), "brightness": shares(bright)})


def by_border(hair: Bool[Tensor, "height width"]) -> dict[str, Bool[Tensor, "height width"]]:
    """The hair divided by the distance of its pixels to the nearest pixel that is not hair."""
    distance = torch.from_numpy(
        cv2.distanceTransform(hair.numpy().astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    )
    return {
        f"within {NEAR:g} px": hair & (distance <= NEAR),
        f"{NEAR:g} to {FAR:g} px": hair & (distance > NEAR) & (distance <= FAR),
        "deeper": hair & (distance > FAR),
    }


def error_bands(
    difference: Float[Tensor, "height width 3"], hair: Bool[Tensor, "height width"]
) -> dict[str, Float[Tensor, "height width 3"]]:
    """The difference of two pictures within the hair as a sum of three bands, finest first."""
    fine, coarse = (_within(difference, hair, sigma) for sigma in (FINE, COARSE))
    return {
        f"finer than {FINE:g} px": difference - fine,
        f"{FINE:g} to {COARSE:g} px": fine - coarse,
        f"coarser than {COARSE:g} px": coarse,
    }


def by_brightness(
    rendered: Float[Tensor, "height width 3"],
    photograph: Float[Tensor, "height width 3"],
    hair: Bool[Tensor, "height width"],
) -> dict[str, Bool[Tensor, "height width"]]:
    """The hair divided into highlights of the photograph, others that the rendering alone has, and the rest."""
    seen, drawn = (_highlights(image, hair) for image in (photograph, rendered))
    return {
        "highlights of the photograph": seen,
        "of the rendering alone": drawn & ~seen,
        "neither": hair & ~seen & ~drawn,
    }


def _highlights(image: Float[Tensor, "height width 3"], hair: Bool[Tensor, "height width"]) -> Tensor:
    """The brightest hundredth of the hair, at least one pixel."""
    grey = (image.mean(dim=2) * hair)[None, None]
    mean = functional.avg_pool2d(grey, SQUARE, 1, SQUARE // 2, count_include_pad=False)
    share = functional.avg_pool2d(hair[None, None].float(), SQUARE, 1, SQUARE // 2, count_include_pad=False)
    bright = (mean / share.clamp(min=1e-6))[0, 0]
    order = bright[hair].sort(descending=True).values
    return hair & (bright >= order[max(round(BRIGHTEST * len(order)), 1) - 1])


def _within(
    image: Float[Tensor, "height width 3"], hair: Bool[Tensor, "height width"], sigma: float
) -> Float[Tensor, "height width 3"]:
    """Blur by a Gaussian; what is not hair has no weight."""
    weight = hair[..., None].to(image)
    return blur_texture(image * weight, sigma) / blur_texture(weight, sigma).clamp(min=1e-6) * weight


def _mean(values: Float[Tensor, "height width"], hair: Bool[Tensor, "height width"]) -> float:
    """Mean over the hair, in `UNIT`."""
    return float(values[hair].double().mean()) / UNIT
