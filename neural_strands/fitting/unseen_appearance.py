"""The appearance of hair that no photograph shows: that of its neighbours on the scalp.

Texels of Z_a without any gradient keep what they were before the networks learned to read them; in a picture they turn
up as dark or coloured patches. Sampling the texture is linear, so its transpose, which autograd computes, sums how many
line pixels of all photographs read each texel.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.fitting.first_colours import filled
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View, Views
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.texture import sample_texture
from neural_strands.raster.visible import interpolate_knots, visible_points

ENOUGH = 4.0
"""Line pixels of all photographs that must read a texel for it to have learned something."""


def fill_unseen_appearance(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Give texels of Z_a that no photograph shows the values of their neighbours, at each knot from root to tip.

    Args:
        model: changed in place, where nothing was learned.
        strands: world metres, with `root_uv`.
        targets: the photographs of the fit.
    """
    seen = texel_weights(model, strands, targets) >= ENOUGH
    knots = model.textures.appearance.detach().unflatten(2, (model.textures.knots, -1))
    for knot in range(model.textures.knots):
        weight = seen[:, :, knot, None].to(knots)
        if bool(weight.any()):
            own = knots[:, :, knot]
            own.copy_(torch.where(weight > 0, own, filled(own * weight, weight)))


@torch.enable_grad()
def texel_weights(
    model: HairModel, strands: Strands, targets: Views | Sequence[View]
) -> Float[Tensor, "height width knot"]:
    """How many line pixels of the photographs read each texel of Z_a, at each knot.

    Raises:
        ValueError: strands without `root_uv`.
    """
    if strands.root_uv is None:
        raise ValueError("strands need root_uv: it says which texels they read")
    height, width, _ = model.textures.appearance.shape
    image = strands.points.new_zeros(height, width, model.textures.knots, requires_grad=True)
    read = sample_texture(image, strands.root_uv)[..., None]
    total = torch.zeros_like(read)
    for target in targets:
        with torch.no_grad():
            lines = model.draw(strands, target.camera).lines
            visible = visible_points(lines, strands.points, model.config.supersample, strands.t)
        knots = torch.zeros_like(read, requires_grad=True)
        (back,) = torch.autograd.grad(interpolate_knots(knots, visible)[:, 0], knots, visible.weight)
        total += back
    return torch.autograd.grad(read, image, total)[0]
