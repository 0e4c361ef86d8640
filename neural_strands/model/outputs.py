"""What a hair model draws of one view."""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.devices.late_numbers import LateNumbers
from neural_strands.foundation.srgb import to_srgb
from neural_strands.raster.lines import LineBuffer
from neural_strands.raster.triangles import TriangleBuffer
from neural_strands.raster.visible import VisiblePoints


class Drawing(NamedTuple):
    """Strands and body as a camera sees them, at `supersample` times the image's resolution.

    Attributes:
        body: the visible faces.
        lines: the visible segments.
    """

    body: TriangleBuffer
    lines: LineBuffer


class HairImage(NamedTuple):
    """The hair alone in one view.

    Attributes:
        rgb: linear colour.
        alpha: opacity.
        coverage: share of each pixel covered by strands.
        drawing: strands and body as the camera sees them.
        visible: the points of strands that are seen.
    """

    rgb: Float[Tensor, "height width 3"]
    alpha: Float[Tensor, "height width"]
    coverage: Float[Tensor, "height width"]
    drawing: Drawing
    visible: VisiblePoints


@dataclass(frozen=True)
class RenderOutput:
    """One rendered view.

    Attributes:
        rgb: hair over body over background, sRGB-encoded; not clamped to [0, 1].
        alpha: opacity of the hair.
        hair_rgb: colour of the hair alone, linear.
        behind_rgb: body over background as strands leave them open (`between_lines`), linear.
        coverage: share of each pixel covered by strands.
        lines: the drawn lines, at `supersample` times the image's resolution.
        body_depth: depth of the body at that resolution, metres along the optical axis; infinite where there is none.
        parts: numbers of visible parts of strands and of the nodes around them, if there was room for fixed ones; hair
            is missing if there are more.
    """

    rgb: Float[Tensor, "height width 3"]
    alpha: Float[Tensor, "height width"]
    hair_rgb: Float[Tensor, "height width 3"]
    behind_rgb: Float[Tensor, "height width 3"]
    coverage: Float[Tensor, "height width"]
    lines: LineBuffer
    body_depth: Float[Tensor, "fine_height fine_width"]
    parts: LateNumbers | None = None

    @property
    def cutout(self) -> Float[Tensor, "height width 4"]:
        """The hair alone, as an RGBA picture: sRGB-encoded colour and opacity."""
        return torch.cat([to_srgb(self.hair_rgb), self.alpha[..., None]], dim=-1)
