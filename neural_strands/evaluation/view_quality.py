"""Compares images of any renderer with photographs: hair region (paper, table 2), whole image, alpha map."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, astuple, dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from neural_strands.evaluation.flip import flip
from neural_strands.evaluation.image_metrics import psnr, sharpness, ssim
from neural_strands.evaluation.lpips import Lpips
from neural_strands.foundation.precision import exact_convolutions

HAIR_COVERAGE = 0.5
"""Coverage above which a pixel belongs to the hair."""


@dataclass(frozen=True)
class RenderedView:
    """A rendering and its photograph.

    Attributes:
        name: the view's name in the capture.
        rendered: sRGB in [0, 1].
        photograph: sRGB in [0, 1].
        mask: coverage of hair in the photograph, if it is known.
        alpha: the renderer's opacity of the hair, if known.
    """

    name: str
    rendered: Float[Tensor, "height width 3"]
    photograph: Float[Tensor, "height width 3"]
    mask: Float[Tensor, "height width"] | None = None
    alpha: Float[Tensor, "height width"] | None = None

    def hair_region(self) -> Bool[Tensor, "height width"]:
        """Pixels of the hair, according to the mask or, without one, to the alpha map.

        Raises:
            ValueError: there is neither a mask nor an alpha map.
        """
        coverage = self.alpha if self.mask is None else self.mask
        if coverage is None:
            raise ValueError(f"view {self.name} has neither a hair mask nor an alpha map: its hair region is not known")
        return coverage >= HAIR_COVERAGE


@dataclass(frozen=True)
class ImageQuality:
    """Similarity of two images over a region.

    Attributes:
        psnr: dB; infinite for equal images.
        ssim: mean structural similarity.
        lpips: perceptual distance, which is also a loss of the fit; None if its weights are not available.
        flip: difference that a person sees when the images alternate; not similar to any loss.
        sharpness: strength of fine detail relative to the photograph's: below 1 blurred, above 1 speckled.
    """

    psnr: float
    ssim: float
    lpips: float | None
    flip: float
    sharpness: float


@dataclass(frozen=True)
class AlphaQuality:
    """Agreement of an alpha map with a hair mask, over the whole image.

    Attributes:
        mean_absolute_error: in [0, 1].
        outline_iou: intersection over union of the pixels with at least one half; 1 if neither shows hair.
    """

    mean_absolute_error: float
    outline_iou: float


@dataclass(frozen=True)
class Quality:
    """All figures of a view, or means over several.

    Attributes:
        hair: figures over the hair region; None without hair.
        image: figures over the whole image.
        alpha: figures of the alpha map; None without one, or without a mask.
    """

    hair: ImageQuality | None
    image: ImageQuality
    alpha: AlphaQuality | None

    def as_dict(self) -> dict[str, dict[str, float | None] | None]:
        """The figures under "hair", "image" and "alpha"; None for what is absent."""
        parts = {"hair": self.hair, "image": self.image, "alpha": self.alpha}
        return {name: None if part is None else asdict(part) for name, part in parts.items()}

    def cells(self) -> tuple[str, ...]:
        """The figures as a row of a table under `HEADS`."""
        found = [
            ("-",) * len(MEASURES) if part is None else (f"{part.psnr:.2f}", *map(_four_digits, astuple(part)[1:]))
            for part in (self.hair, self.image)
        ]
        error, overlap = (None, None) if self.alpha is None else astuple(self.alpha)
        return (*found[0], *found[1], _four_digits(error), _four_digits(overlap))


MEASURES = ("PSNR, dB", "SSIM", "LPIPS", "FLIP", "sharpness")
"""Heads of the columns of one region."""
HEADS = (
    *(f"{region} {measure}" for region in ("hair", "image") for measure in MEASURES),
    "alpha error",
    "outline IoU",
)
"""Heads of the columns that `Quality.cells` fills."""


@dataclass(frozen=True)
class ViewQuality:
    """One view.

    Attributes:
        view: the compared images, on the CPU.
        quality: the figures.
    """

    view: RenderedView
    quality: Quality


@torch.no_grad()
def view_qualities(views: Iterable[RenderedView], metric: Lpips | None) -> list[ViewQuality]:
    """Compare renderings with photographs, one view at a time.

    Args:
        views: on the metric's device; read one by one.
        metric: LPIPS, if there is one.

    Raises:
        ValueError: a view has neither a hair mask nor an alpha map, or is too small for a metric.
    """
    results = []
    for view in views:
        region = view.hair_region()
        hair = image_quality(view.rendered, view.photograph, metric, region) if bool(region.any()) else None
        image = image_quality(view.rendered, view.photograph, metric)
        alpha = None if view.alpha is None or view.mask is None else alpha_quality(view.alpha, view.mask)
        results.append(ViewQuality(_on_cpu(view), Quality(hair, image, alpha)))
    return results


def mean_quality(views: Sequence[ViewQuality]) -> Quality:
    """Mean of each figure over the views that have it; at least one view."""
    found = [each.quality for each in views]
    hair = [quality.hair for quality in found if quality.hair is not None]
    alpha = [quality.alpha for quality in found if quality.alpha is not None]
    return Quality(
        ImageQuality(*_means(hair)) if hair else None,
        ImageQuality(*_means([quality.image for quality in found])),
        AlphaQuality(*_means(alpha)) if alpha else None,
    )


def image_quality(
    rendered: Float[Tensor, "height width 3"],
    photograph: Float[Tensor, "height width 3"],
    metric: Lpips | None,
    region: Bool[Tensor, "height width"] | None = None,
) -> ImageQuality:
    """Compare two images, over a region or completely.

    Raises:
        ValueError: the images are too small for a metric.
    """
    weight = None if region is None else region.to(rendered)
    with exact_convolutions():
        distance = None if metric is None else float(metric(rendered, photograph, weight))
    quality = (float(psnr(rendered, photograph, weight)), float(ssim(rendered, photograph, weight)))
    detail = float(sharpness(rendered, photograph, weight))
    return ImageQuality(*quality, distance, flip(rendered, photograph, weight), detail)


def alpha_quality(alpha: Float[Tensor, "height width"], mask: Float[Tensor, "height width"]) -> AlphaQuality:
    """Compare an alpha map with a hair mask, over the whole image."""
    shown, true = alpha >= HAIR_COVERAGE, mask >= HAIR_COVERAGE
    union = int((shown | true).sum())
    overlap = int((shown & true).sum()) / union if union else 1.0
    return AlphaQuality(float((alpha - mask).abs().mean()), overlap)


def _means(rows: Sequence[ImageQuality] | Sequence[AlphaQuality]) -> list[Any]:
    """Mean of each field; None if any row lacks it."""
    columns = zip(*(astuple(row) for row in rows), strict=True)
    return [None if None in column else sum(column) / len(column) for column in columns]


def _four_digits(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _on_cpu(view: RenderedView) -> RenderedView:
    mask, alpha = (None if image is None else image.cpu() for image in (view.mask, view.alpha))
    return RenderedView(view.name, view.rendered.cpu(), view.photograph.cpu(), mask, alpha)
