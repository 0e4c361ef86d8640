"""Colours of the background: means of the pixels that show it, continued smoothly where none does."""

from collections.abc import Iterable

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation.gradients import weighted_gradient
from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.views import View
from neural_strands.model.surround.background import Background, blurred_around, sample_around, sample_wrapped, wrapped

ROWS = 96
"""Directions from pole to pole in which colours are continued; twice as many around."""
WIDTHS, CONTINUED = (60.0, 30.0, 15.0, 7.5, 4.0, 2.0), 0.02
"""Standard deviations over which colours are averaged where no pixel shows them, degrees, and the weight that each mean
has in the next, relative to a direction that is seen."""
AROUND = 0.5
"""Weight of what lies around a texel in its colour, pixels: those that hardly any pixel shows make no seams."""


def background_colours(
    background: Background, photographs: Iterable[tuple[View, Float[Tensor, "height width"]]]
) -> Float[Tensor, "3 rows columns"] | None:
    """Linear colours of the shell; None if no pixel shows it.

    Args:
        background: the shell, whose distances are known.
        photographs: photographs, with the weight of each pixel in the background.
    """
    rows, columns = background.colour.shape[1:]
    total = background.colour.new_zeros(4, rows, columns)
    for view, share in photographs:
        picture = torch.zeros_like(total).requires_grad_()
        shown = sample_around(picture, background.directions(view.camera))
        light = to_linear(view.image).permute(2, 0, 1)
        # The transpose of sampling.
        total += weighted_gradient(shown, torch.cat([light * share, share[None]]), picture)
    # What lies in a repeated column belongs to the column that it repeats.
    total[..., 1] += total[..., -1]
    total[..., -2] += total[..., 0]
    total = total[..., 1:-1]
    return continued(total[:3], total[3]) if total[3].any() else None


def continued(
    total: Float[Tensor, "3 rows columns"], weight: Float[Tensor, "rows columns"]
) -> Float[Tensor, "3 rows columns"]:
    """Means of texels that pixels show; the others continue their surroundings.

    Args:
        total: sums of the pixels' colours.
        weight: sums of their weights, more than zero for some texels.
    """
    few = min(ROWS, len(weight))
    sums = F.adaptive_avg_pool2d(torch.cat([total, weight[None]]), (few, 2 * few)) * (len(weight) / few) ** 2
    seen = sums[3].clamp(max=1.0)
    known = torch.cat([sums[:3] / sums[3].clamp(min=1e-6) * seen, seen[None]])
    colour = (known[:3].sum(dim=(1, 2)) / seen.sum())[:, None, None].expand_as(known[:3])
    for sigma in WIDTHS:
        near = blurred_around(known, sigma)
        colour = (near[:3] + CONTINUED * colour) / (near[3] + CONTINUED)
    v, u = (((torch.arange(n, device=weight.device) + 0.5) / n) for n in weight.shape)
    v, u = torch.meshgrid(v, u, indexing="ij")
    around = sample_wrapped(wrapped(colour), u, v)
    return (total + AROUND * around) / (weight + AROUND)
