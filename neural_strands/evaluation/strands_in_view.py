"""Compares strands with a photograph, without true strands: by its streaks, and by where its hair is.

The orientation of the photograph is that of the line-based stereo (`lmvs.orientation`). A fit turns strands along the
streaks of its training photographs (`fitting.photographs.streak_loss`), so only held-out views are independent.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.evaluation.view_quality import HAIR_COVERAGE
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View
from neural_strands.lmvs.orientation import OrientationConfig, angle_difference, luma, orientation_map
from neural_strands.model.compositing import area_mean
from neural_strands.raster.lines import LineBuffer

WITHIN = math.radians(20)
"""Largest angle between a strand in the picture and the photograph's streaks that counts as correct."""


@dataclass(frozen=True)
class StrandsInView:
    """Agreement of drawn strands with one photograph, or means over several; percent.

    Attributes:
        direction: share of the hair's pixels, each weighted by the confidence of its orientation, in which the drawn
            strands run within 20 degrees of the photograph's streaks; None where no strand is drawn on hair.
        on_background: share of the drawn opacity that lies outside the person or, without a mask of the person,
            outside the hair; None without masks, or where nothing is drawn.
        mask_on_background: the same share of the photograph's hair mask, whose soft border reaches over the background:
            what hair drawn exactly as the mask would have; None without a hair mask, or where it is empty.
    """

    direction: float | None
    on_background: float | None
    mask_on_background: float | None

    def as_dict(self) -> dict[str, float | None]:
        """The figures by name."""
        return asdict(self)

    def cells(self) -> tuple[str, ...]:
        """The figures as a row of a table under `HEADS`."""
        return tuple("-" if value is None else f"{value:.1f}" for value in astuple(self))


HEADS = ("direction within 20°, %", "on background, %", "mask on background, %")
"""Heads of the columns that `StrandsInView.cells` fills."""


@torch.no_grad()
def strands_in_view(
    lines: LineBuffer, points: Float[Tensor, "strand point 3"], alpha: Float[Tensor, "height width"], view: View
) -> StrandsInView:
    """Compare drawn strands with a photograph.

    Args:
        lines: drawn strands, at a whole multiple of the photograph's resolution.
        points: the strands, world metres.
        alpha: opacity of the rendered hair.
        view: the photograph.
    """
    angle, share = drawn_orientation(lines, points, view.camera)
    streaks = orientation_map(luma(view.image), OrientationConfig())
    hair = share >= HAIR_COVERAGE
    if view.hair_mask is not None:
        hair = hair & (view.hair_mask >= HAIR_COVERAGE)
    weight = streaks.confidence * hair
    right = angle_difference(angle, streaks.angle) <= WITHIN
    inside = view.hair_mask if view.person_mask is None else view.person_mask
    outside, own = (
        None if covered is None or inside is None else _share(covered, inside < HAIR_COVERAGE)
        for covered in (alpha, view.hair_mask)
    )
    return StrandsInView(_share(weight, right), outside, own)


def mean_strands_in_view(found: Sequence[StrandsInView]) -> StrandsInView:
    """Mean of each figure over the views that have it."""
    columns = zip(*(astuple(each) for each in found), strict=True)
    known = [[value for value in column if value is not None] for column in columns] or [[] for _ in HEADS]
    return StrandsInView(*(sum(column) / len(column) if column else None for column in known))


def drawn_orientation(
    lines: LineBuffer, points: Float[Tensor, "strand point 3"], camera: Camera
) -> tuple[Float[Tensor, "height width"], Float[Tensor, "height width"]]:
    """Mean orientation in the picture of the strands that each pixel shows, in [0, pi), and the share of it they cover.

    Args:
        lines: drawn strands, at a whole multiple of the camera's resolution.
        points: the strands, world metres.
        camera: camera of the picture.
    """
    drawn = lines.segment >= 0
    segment = lines.segment.clamp(min=0)
    pixels, _ = camera.to(points.device).project(points.reshape(-1, 3))
    start = segment + segment // (points.shape[1] - 1)
    x, y = torch.nn.functional.normalize(pixels[start + 1] - pixels[start], dim=-1).unbind(-1)
    # Average double angles, because orientations are unsigned.
    double = torch.stack([x * x - y * y, 2 * x * y, torch.ones_like(x)], dim=-1) * drawn[..., None]
    cosine, sine, share = area_mean(double, lines.segment.shape[0] // camera.height).unbind(-1)
    return (0.5 * torch.atan2(sine, cosine)).remainder(math.pi), share


def _share(weight: Float[Tensor, "height width"], chosen: Tensor) -> float | None:
    """Percentage of the weight where `chosen` is true; None without weight."""
    total = float(weight.sum())
    return 100 * float((weight * chosen).sum()) / total if total > 0 else None
