"""How the colours of strands change from view to view, in closed form.

The colour of a pixel is about the mean of the colours of the points that it sees, and these are linear in the textures.
Least squares therefore tell both the colours of the strands and their changes with the view. Each texel is seen by few
pixels, so the squares of all changes count as well (ridge regression).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.sparse.linalg import LinearOperator, cg
from torch import Tensor

from neural_strands.foundation.gradients import weighted_gradient
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import View, Views
from neural_strands.model.hair_model import HairModel
from neural_strands.model.hair_volume import HairVolume, hair_volume
from neural_strands.model.view_functions import COUNT
from neural_strands.raster.lines import LineBuffer
from neural_strands.raster.texture import sample_texture
from neural_strands.raster.visible import interpolate_knots, visible_points

CLOSE = math.radians(15)
"""Usual angle between neighbouring photographs up to which changes between them can be told from noise. A path-traced
capture with 26 degrees lost 0.3 dB by them; photographs of a face 6 degrees apart gained over 1 dB."""
RIDGE_COLOUR, RIDGE_VIEW = 0.3, 6.0
"""Weight of the squares of the colours' and the changes' texels, in pixels."""
LEAST_COVERAGE, LEAST_HAIR = 0.3, 0.95
"""A pixel counts if strands cover at least this share of it, and the hair mask says that it is hair."""
MOST_VIEWS = 100
"""Most photographs that are used, evenly spread over all of them."""
ITERATIONS, PRECISION = 15, 1e-4
"""Most steps of conjugate gradients, and the relative residual at which they stop."""


@dataclass(frozen=True)
class SeenPoints:
    """The points that a photograph sees, and what remains of its colours.

    Attributes:
        strand: index of each point's strand.
        t: parameter on the strand.
        pixel: index, among those that count, of the pixel that sees it.
        share: of that pixel.
        functions: 1, then the view's functions.
        rest: encoded colour of the pixels that count, less what is known.
    """

    strand: Int64[Tensor, " point"]
    t: Float[Tensor, " point"]
    pixel: Int64[Tensor, " point"]
    share: Float[Tensor, " point"]
    functions: Float[Tensor, " function"]
    rest: Float[Tensor, "pixel 3"]

    def pixels(self, knots: Float[Tensor, "root function knot 3"]) -> Float[Tensor, "pixel 3"]:
        """Colours of the pixels, linear in those of the knots."""
        own = torch.einsum("rfkc,f->rkc", knots, self.functions)
        points = interpolate_knots(own, self.strand, self.t) * self.share[:, None]
        return torch.zeros_like(self.rest).index_add(0, self.pixel, points)


def initialise_view_colours(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Initialise the changes of colours with the view, and improve the colours in the first channels of Z_a.

    Args:
        model: modified in place; its first colours are known, and its networks leave them alone. It has room for the
            changes (`ScalpTextures.change_with_view`).
        strands: world metres, with `root_uv`.
        targets: the photographs of the fit.
    """
    if model.config.textures.appearance_channels < 3:
        return
    known = model.textures.sample_appearance(strands.chart_positions())[..., :3] + model.shading.mean
    _add_solution(model, strands, [_unexplained(model, strands, target, known.detach()) for target in _chosen(targets)])


def improve_colours(model: HairModel, strands: Strands, targets: Views | Sequence[View]) -> None:
    """Improve colours and their changes, once networks have learned, by what renderings lack in the photographs.

    The arguments are those of `initialise_view_colours`.
    """
    if model.config.textures.appearance_channels < 3:
        return
    volume = hair_volume(strands.points)
    _add_solution(model, strands, [_lacking(model, strands, target, volume) for target in _chosen(targets)])


def _chosen(targets: Views | Sequence[View]) -> Iterator[View]:
    step = -(-len(targets) // MOST_VIEWS) or 1
    return (targets[index] for index in range(0, len(targets), step))


def _add_solution(model: HairModel, strands: Strands, seen: Sequence[SeenPoints]) -> None:
    """Add to the textures what explains best what remains of the photographs' colours."""
    textures, uv = model.textures, strands.chart_positions()
    height, width, _ = textures.appearance.shape
    functions = 1 + COUNT

    def sampled(texels: Tensor) -> Tensor:
        return sample_texture(texels, uv).view(len(uv), functions, textures.knots, 3)

    def normal(texels: Tensor) -> Tensor:
        return _transposed(texels, sampled, seen, lambda part, knots: part.pixels(knots))

    start = uv.new_zeros(height, width, functions * textures.knots * 3)
    right = _transposed(start, sampled, seen, lambda part, _: part.rest)
    ridge = torch.full((functions, textures.knots, 3), RIDGE_VIEW, device=uv.device)
    ridge[0] = RIDGE_COLOUR
    white = torch.zeros_like(start).unflatten(2, ridge.shape)
    white[:, :, 0] = 1
    # The functions have variance 1, so the diagonal of each is about that of the constant.
    counts = normal(white.flatten(2)).unflatten(2, ridge.shape)[:, :, :1]
    diagonal = (counts + ridge).flatten(2)
    solution = _solved(lambda x: normal(x) + ridge.flatten() * x, right, diagonal).unflatten(2, ridge.shape)
    with torch.no_grad():
        textures.appearance.unflatten(2, (textures.knots, -1))[..., :3] += solution[:, :, 0]
        textures.view += solution[:, :, 1:].permute(2, 0, 1, 3, 4).flatten(3)


def _solved(product: Callable[[Tensor], Tensor], right: Tensor, diagonal: Tensor) -> Tensor:
    """Solve a symmetric positive definite system by conjugate gradients, given about the diagonal of its matrix."""
    size = right.numel()

    def applied(vector: np.ndarray) -> np.ndarray:
        return product(torch.from_numpy(vector).to(right).view_as(right)).flatten().cpu().numpy()

    inverse = 1 / diagonal.flatten().cpu().numpy()
    found, _ = cg(
        LinearOperator((size, size), applied),
        right.flatten().cpu().numpy(),
        rtol=PRECISION,
        maxiter=ITERATIONS,
        M=LinearOperator((size, size), lambda vector: inverse * vector),
    )
    return torch.from_numpy(found).to(right).view_as(right)


@torch.enable_grad()
def _transposed(
    texels: Tensor,
    sampled: Callable[[Tensor], Tensor],
    seen: Sequence[SeenPoints],
    wanted: Callable[[SeenPoints, Tensor], Tensor],
) -> Tensor:
    """Take what is wanted at the pixels of all photographs back to the texels that they read."""
    texels = texels.detach().requires_grad_()
    knots = sampled(texels)
    own = knots.detach().requires_grad_()
    total = torch.zeros_like(own)
    for part in seen:
        pixels = part.pixels(own)
        total += weighted_gradient(pixels, wanted(part, own).detach(), own, retain_graph=True)
    return weighted_gradient(knots, total, texels)


@torch.no_grad()
def _unexplained(model: HairModel, strands: Strands, target: View, known: Float[Tensor, "strand knot 3"]) -> SeenPoints:
    """What a photograph has beyond known colours, the same in all views."""
    found = _seen(model, strands, target, model.draw(strands, target.camera).lines, target.image)
    own = known.new_zeros(len(known), len(found.functions), *known.shape[1:])
    own[:, 0] = known
    return replace(found, rest=found.rest - found.pixels(own))


@torch.no_grad()
def _lacking(model: HairModel, strands: Strands, target: View, volume: HairVolume) -> SeenPoints:
    """What a photograph has beyond its rendering."""
    rendered = model.render(strands, target.camera, volume=volume, photographed=True)
    return _seen(model, strands, target, rendered.lines, target.image - rendered.rgb)


def _seen(
    model: HairModel, strands: Strands, target: View, lines: LineBuffer, rest: Float[Tensor, "height width 3"]
) -> SeenPoints:
    """The points that a photograph sees, given the lines drawn for it and what remains of its colours."""
    visible = visible_points(lines, strands.points, model.config.supersample, strands.t)
    count = target.camera.width * target.camera.height
    covered = visible.weight.new_zeros(count).index_add_(0, visible.pixel, visible.weight)
    sure = covered > LEAST_COVERAGE * model.config.supersample**2
    if target.hair_mask is not None:
        sure &= target.hair_mask.reshape(-1) > LEAST_HAIR
    number = sure.cumsum(0) - 1
    kept = sure[visible.pixel]
    strand, t, pixel = visible.strand[kept], visible.t[kept], visible.pixel[kept]
    share = (visible.weight / covered.clamp(min=1)[visible.pixel])[kept]
    functions = torch.cat([share.new_ones(1), model.viewpoint(target.camera, photographed=True).functions])
    return SeenPoints(strand, t, number[pixel], share, functions, rest.reshape(-1, 3)[sure])
