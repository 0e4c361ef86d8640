"""Streaks in the photographs' hair, and the loss that turns visible strands along them.

The paper's images reach the shape through rendered colours alone. Streaks say more directly which way visible hair
runs, where stereo finds no segments as well.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import torch
from jaxtyping import Bool, Float, Float16, Int32, Int64
from torch import Tensor

from neural_strands.foundation.configs import Between
from neural_strands.foundation.devices.selection import selected
from neural_strands.foundation.devices.transfers import sent
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import View
from neural_strands.lmvs.orientation import OrientationConfig, luma, orientation_map

SMOOTH = 1e-3
"""Squared sine below which the loss is quadratic (1.8 degrees)."""


@dataclass(frozen=True)
class StreakConfig:
    """How strands are compared with the photographs' streaks."""

    views: Annotated[int, Between(1, 1000)] = 4
    """Views compared in one shape step."""
    pixels: Annotated[int, Between(1, 10_000_000)] = 40_000
    """Pixels compared in each of them."""
    longest_side: Annotated[int, Between(16, 16384)] = 1024
    """Photographs are reduced to this many pixels along their longer side."""


@dataclass(frozen=True)
class Streaks:
    """Streaks of one view, where it shows hair.

    Attributes:
        camera: the view at the resolution of the streaks.
        pixel: row * width + column of each pixel.
        streak: its confidence times the cosine and sine of twice its angle (see `lmvs.orientation`).
        body: depth of the body at each pixel, metres along the optical axis; infinite where there is none. It is kept
            because neither camera nor body moves during a fit.
    """

    camera: Camera
    pixel: Int32[Tensor, " pixel"]
    streak: Float16[Tensor, "pixel 2"]
    body: Float[Tensor, " pixel"]

    def body_depth(self) -> Float[Tensor, "height width"]:
        """Depth of the body as an image; infinite at pixels that are not compared."""
        nothing = self.body.new_full((self.camera.height * self.camera.width,), math.inf)
        return nothing.index_copy_(0, self.pixel.long(), self.body).view(self.camera.height, self.camera.width)


def find_streaks(view: View, hair: Bool[Tensor, "height width"], body: Float[Tensor, "height width"]) -> Streaks:
    """Find the streaks of a view.

    Args:
        view: the photograph.
        hair: which of its pixels show hair.
        body: depth of the body, metres along the optical axis; infinite where there is none.
    """
    seen = orientation_map(luma(view.image), OrientationConfig())
    pixel = torch.nonzero(hair.reshape(-1)).squeeze(1)
    angle, confidence = (2 * seen.angle.reshape(-1))[pixel], seen.confidence.reshape(-1)[pixel]
    streak = confidence[:, None] * torch.stack([angle.cos(), angle.sin()], dim=-1)
    return Streaks(view.camera, pixel.int(), streak.half(), body.reshape(-1)[pixel])


def streak_loss(
    strands: Float[Tensor, "some point 3"],
    row: Int64[Tensor, " root"],
    views: Sequence[Streaks],
    fronts: Sequence[Int64[Tensor, "height width"]],
    pixels: int,
    random: torch.Generator,
) -> Float[Tensor, ""]:
    """Sine of the angle between visible strands and the streaks of photographs, times a weight; mean over pixels.

    The weight is the confidence of the pixel's streak, so hair without streaks asks for nothing. It is less where the
    strand runs towards the camera: its direction in the picture then says little.

    Args:
        strands: the strands that a step decoded.
        row: for every strand, its place among `strands`, or -1 if it was not decoded.
        views: the streaks of the views.
        fronts: for each of these views, the frontmost segment of all strands at each pixel, -1 if there is none.
        pixels: number of pixels drawn in each view.
        random: draws them.
    """
    total, pairs = strands.new_zeros(()), row.new_zeros(())
    for streaks, front in zip(views, fronts, strict=True):
        if len(streaks.pixel) == 0:
            continue
        drawn = sent(torch.randint(len(streaks.pixel), (pixels,), generator=random), strands.device)
        segment = front.reshape(-1)[streaks.pixel[drawn].long()]
        place = torch.where(segment >= 0, row[segment.clamp(min=0) // (strands.shape[1] - 1)], -1)
        counts = place >= 0
        # What does not count is at a root, which no camera has in its plane: its gradient is zero, not undefined.
        start = torch.where(counts, place * strands.shape[1] + segment % (strands.shape[1] - 1), 0)
        start, drawn, counts = selected(counts, (start, drawn, counts))
        # With `strands[place, point]`, threads would sum gradients in an order that differs from run to run.
        ends = strands.reshape(-1, 3).index_select(0, torch.cat([start, start + 1])).view(2, -1, 3)
        misfit = _weighted_sine(ends[0], ends[1], streaks, drawn)
        total, pairs = total + torch.where(counts, misfit, 0.0).sum(), pairs + counts.sum()
    return total / pairs.clamp(min=1)


def _weighted_sine(
    start: Float[Tensor, "pair 3"], end: Float[Tensor, "pair 3"], streaks: Streaks, drawn: Int64[Tensor, " pair"]
) -> Float[Tensor, " pair"]:
    """Sine of the angle between projected segments and streaks, times a weight that has no gradient."""
    camera = streaks.camera
    (first, near), (last, far) = camera.project(start), camera.project(end)
    x, y = (last - first).unbind(-1)
    squared = (x.square() + y.square()).clamp(min=1e-12)
    doubled = streaks.streak[drawn].float()
    confidence = doubled.norm(dim=-1)
    cosine, sine = (doubled / confidence[:, None].clamp(min=1e-12)).unbind(-1)
    # sin^2 D = (1 - cos 2D) / 2, with cos 2D from the double angles of both directions.
    aligned = ((x.square() - y.square()) * cosine + 2 * x * y * sine) / squared
    with torch.no_grad():
        # Not `Camera.footprint`, for which the host would wait.
        focal = 0.5 * (camera.intrinsics[0, 0] + camera.intrinsics[1, 1])
        across = squared.sqrt() * torch.minimum(near, far) / focal
        weight = confidence * (across / (end - start).norm(dim=-1).clamp(min=1e-12)).clamp(max=1.0)
    return weight * (0.5 * (1 - aligned).clamp(min=0.0) + SMOOTH).sqrt()
