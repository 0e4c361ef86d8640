"""The appearance of hair that photographs hardly show, taken from its neighbours on the scalp.

Texels of Z_a that never receive a gradient keep their initial values, which the trained networks turn into dark or
coloured patches. So do those of hair at the edge of what views see: a few pixels that graze it, or that look into its
shadow, do not tell how it looks from where it faces, and where masks are a little too wide, pixels at their border show
the background. Seen from the photographs, though, they look right; only cameras elsewhere see its neighbours' look.

Neighbours tell the colour of a region and not how strands differ within it: what is filled in is smooth. So it also
takes the fine detail of small patches of texels that were learned elsewhere.

Sampling the texture is linear, so its transpose, which autograd computes, takes the line pixels of all photographs back
to the texels that they read.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from neural_strands.fitting.first_colours import scatter_to_texture
from neural_strands.flow.filling import pull_push
from neural_strands.foundation.gradients import weighted_gradient
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View, Views
from neural_strands.model.hair_model import HairModel
from neural_strands.raster.dilation import widen
from neural_strands.raster.texture import blur_texture
from neural_strands.raster.visible import interpolate_knots, visible_points

ENOUGH, ENOUGH_UNSEEN = 4.0, 256.0
"""Number of line pixels, over all photographs, that must read a texel for it to count as learned: where hair faces
several views, and where it does not."""
FACING = 0.35
"""A view shows how hair looks only if the cosine between the direction out of the head and that to the camera exceeds
this."""
PATCH, FINE, ODD = 3, 1 / 40, 2.0
"""Side of a patch in texels, the standard deviation of the Gaussian that separates detail from colour, in sides of the
texture, and the largest detail, in its standard deviations: a single bright patch shows as a white strand."""
BORDER = 6
"""Pixels from the border of the hair mask within which line pixels do not count where hair does not face several
views."""


def fill_unseen_appearance(
    model: HairModel, strands: Strands, targets: Views | Sequence[View], unseen: Bool[Tensor, "strand part"]
) -> None:
    """Give texels of Z_a that photographs show too little the values of their neighbours, at each knot.

    Texels that no photograph shows get them for all cameras. Those of hair that views only graze keep their own for
    cameras near the photographs, which they show as photographed.

    Args:
        model: `textures.appearance`, `textures.elsewhere` and `textures.view` are modified in place.
        strands: world metres, with `root_uv`.
        targets: the photographs of the fit.
        unseen: which parts of the strands, from root to tip, face too few views (see `flow.unseen.unseen_parts`, with
            `FACING`).

    Raises:
        ValueError: the strands have no `root_uv`.
    """
    pixels, inner = knot_pixels(model, strands, targets).unbind(dim=2)
    parts = unseen.to(pixels)[:, None]
    share = functional.interpolate(parts, pixels.shape[1], mode="linear", align_corners=True)[:, 0]
    faced = (1 - share) * pixels / ENOUGH + share * inner / ENOUGH_UNSEEN
    textures = model.textures
    height, width, _ = textures.appearance.shape
    with torch.enable_grad():
        places = strands.chart_positions()
        sums, _ = scatter_to_texture(torch.cat([faced, pixels], dim=1), places, height, width)
    trust, count = sums.chunk(2, dim=2)
    learned = (count >= ENOUGH).to(trust)
    own = textures.appearance.detach().unflatten(2, (textures.knots, -1))
    far = with_detail(_filled(own, learned * trust), learned * trust)
    own.copy_(with_detail(_filled(own, learned), learned))
    for change in textures.view.unflatten(3, (textures.knots, -1)):
        change.copy_(_filled(change, learned))
    textures.elsewhere.copy_((far - own).flatten(2))


def _filled(
    values: Float[Tensor, "height width knot feature"], trust: Float[Tensor, "height width knot"]
) -> Float[Tensor, "height width knot feature"]:
    """Each knot's values, filled where they are not trusted; a knot that is trusted nowhere keeps its own."""
    knots = zip(values.unbind(dim=2), trust.unbind(dim=2), strict=True)
    return torch.stack([pull_push(own, sure) if bool((sure > 0).any()) else own for own, sure in knots], dim=2)


def with_detail(
    filled: Float[Tensor, "height width knot feature"], trust: Float[Tensor, "height width knot"]
) -> Float[Tensor, "height width knot feature"]:
    """Give texels that are not trusted the fine detail of those whose knots are all trusted, patch by patch.

    Args:
        filled: values of all texels, smooth where they are not trusted.
        trust: below 1, knots have that share of their own values, and take the rest of the detail.
    """
    height, width = filled.shape[:2]
    trust = trust.clamp(max=1.0)
    whole = (trust >= 1).all(dim=2)
    places = whole.nonzero()
    if len(places) == 0:
        return filled
    sure = whole[..., None].to(filled)
    blurred = blur_texture(torch.cat([filled.flatten(2) * sure, sure], dim=2), FINE * width)
    smooth = blurred[..., :-1] / blurred[..., -1:].clamp(min=1e-6)
    detail = (filled.flatten(2) - smooth) * sure
    largest = ODD * detail[whole].square().mean(dim=0).sqrt()
    detail = detail.clamp(-largest, largest).view_as(filled)
    rows, columns = (torch.arange(size, device=filled.device) for size in (height, width))
    patches = (-(-height // PATCH), -(-width // PATCH))
    # Drawn on the CPU: the same on every device.
    drawn = torch.randint(len(places), patches, generator=torch.Generator().manual_seed(0)).to(filled.device)
    corner = places[drawn[rows // PATCH][:, columns // PATCH]]
    row = (corner[..., 0] + (rows % PATCH)[:, None]).clamp(max=height - 1)
    column = (corner[..., 1] + columns % PATCH).clamp(max=width - 1)
    return filled + (1 - trust)[..., None] * detail[row, column]


@torch.enable_grad()
def knot_pixels(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> Float[Tensor, "strand knot 2"]:
    """Number of line pixels of the photographs that read each knot of each strand, and of those far from the border."""
    total = strands.points.new_zeros(len(strands.points), model.textures.knots, 2)
    for target in targets:
        with torch.no_grad():
            lines = model.draw(strands, target.camera).lines
            visible = visible_points(lines, strands.points, model.config.supersample, strands.t)
            inner = visible.weight
            if target.hair_mask is not None:
                inner = inner * _far_inside(target.hair_mask).reshape(-1)[visible.pixel]
        knots = torch.zeros_like(total).requires_grad_()
        between = interpolate_knots(knots, visible.strand, visible.t)
        total += weighted_gradient(between, torch.stack([visible.weight, inner], dim=1), knots)
    return total


def _far_inside(mask: Float[Tensor, "height width"]) -> Bool[Tensor, "height width"]:
    """Pixels of hair more than `BORDER` pixels, along rows and columns, from any without; the image's edge is none."""
    return widen((mask <= 0.5).to(mask.dtype), BORDER) == 0
