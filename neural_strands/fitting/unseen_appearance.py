"""The appearance of hair that no photograph shows, taken from its neighbours on the scalp.

Texels of Z_a that never receive a gradient keep their initial values, which the trained networks turn into dark or
coloured patches. Sampling the texture is linear, so its transpose, which autograd computes, counts the line pixels of
all photographs that read each texel.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.fitting.first_colours import fill_texture
from neural_strands.foundation.gradients import weighted_gradient
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View, Views
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.texture import sample_texture
from neural_strands.raster.visible import interpolate_knots, visible_points

ENOUGH = 4.0
"""Number of line pixels, over all photographs, that must read a texel for it to count as learned."""


def fill_unseen_appearance(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Give texels of Z_a that no photograph shows the values of their neighbours, at each knot from root to tip.

    Args:
        model: modified in place, only in texels that did not learn.
        strands: world metres, with `root_uv`.
        targets: the photographs of the fit.
    """
    seen = texel_weights(model, strands, targets) >= ENOUGH
    knots = model.textures.appearance.detach().unflatten(2, (model.textures.knots, -1))
    for knot in range(model.textures.knots):
        weight = seen[:, :, knot, None].to(knots)
        if bool(weight.any()):
            own = knots[:, :, knot]
            own.copy_(torch.where(weight > 0, own, fill_texture(own * weight, weight)))


@torch.enable_grad()
def texel_weights(
    model: HairModel, strands: Strands, targets: Views | Sequence[View]
) -> Float[Tensor, "height width knot"]:
    """Number of line pixels of the photographs that read each texel of Z_a, at each knot.

    Raises:
        ValueError: the strands have no `root_uv`.
    """
    height, width, _ = model.textures.appearance.shape
    image = strands.points.new_zeros(height, width, model.textures.knots, requires_grad=True)
    read = sample_texture(image, strands.chart_positions())[..., None]
    total = torch.zeros_like(read)
    for target in targets:
        with torch.no_grad():
            lines = model.draw(strands, target.camera).lines
            visible = visible_points(lines, strands.points, model.config.supersample, strands.t)
        knots = torch.zeros_like(read, requires_grad=True)
        between = interpolate_knots(knots, visible.strand, visible.t)[:, 0]
        total += weighted_gradient(between, visible.weight, knots)
    return weighted_gradient(read, total, image)
