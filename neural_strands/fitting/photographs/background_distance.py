"""How far the background is: in each direction, at the distance at which photographs agree best about its colours.

A plane sweep (Collins, A space-sweep approach to true multi-image matching, CVPR 1996) with spheres for planes: for
each radius, the background of all photographs is put on a sphere, and colours of different photographs are compared
where they meet.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.nn import functional as F

from neural_strands.foundation.srgb import to_linear, to_srgb
from neural_strands.geometry.views import View
from neural_strands.model.compositing import area_mean
from neural_strands.model.surround.background import (
    blurred_around,
    equirectangular,
    followed_rays,
    sphere_directions,
    wrapped,
)

NEAREST, FARTHEST, RADII = 0.4, 30.0, 28
"""Radii of the spheres: between these, in metres, and so many, evenly spaced in their inverses."""
PIXELS = 1.5
"""Photographs are reduced until about so many pixels go into a cell, along each axis."""
PURE = 0.95
"""Pixels count if at least this share of them is background."""
AROUND = (6.0, 18.0)
"""Standard deviations of the surroundings that vote on a distance, degrees."""
EVERYWHERE = (0.2, 2.0, 20.0, 1e6)
"""Weights to try of the disagreement on the whole sphere in each vote, relative to that of one more photograph in a
cell; with the last one, all distances are alike."""
CHANCE = 1.05
"""Ratio of errors up to which distances that are more alike are preferred."""
SMOOTH, CONTINUED = (20.0, 5.0), 0.02
"""Standard deviations by which inverse distances are smoothed, degrees, and the weight that each has in the next: what
no two photographs show continues its surroundings."""
LEAST_CLEAR, TINY = 1e-3, 1e-6
"""Weight of a cell where all distances explain the photographs equally well, and smallest divisor."""


@dataclass(frozen=True)
class Shot:
    """The background of a reduced photograph.

    Attributes:
        origin: of the rays, metres.
        rays: unit directions to pixels that show nothing but background.
        colours: of those pixels, encoded: steps are about equally visible in dark and bright places.
    """

    origin: Float[Tensor, "3"]
    rays: Float[Tensor, "3 1 pixel"]
    colours: Float[Tensor, "pixel 3"]


def background_shot(view: View, share: Float[Tensor, "height width"], rows: int) -> Shot:
    """The pixels of a photograph that show background.

    Args:
        view: the photograph.
        share: of each pixel that is background.
        rows: cells of a sphere from pole to pole.
    """
    camera = view.camera.in_room()
    rays = camera.ray_planes().permute(1, 2, 0)
    pixels = float(camera.intrinsics[0, 0]) * math.pi / rows  # that span a cell
    factor = max(1, min(round(pixels / PIXELS), *rays.shape[:2]))
    light = area_mean(torch.cat([to_linear(view.image) * share[..., None], share[..., None]], dim=2), factor)
    pure = light[..., 3] > PURE
    few = light[pure]
    return Shot(
        camera.position,
        F.normalize(area_mean(rays, factor)[pure], dim=-1).T[:, None],
        to_srgb(few[:, :3] / few[:, 3:]),
    )


@torch.no_grad()
def background_nearness(
    shots: Sequence[Shot], centre: Float[Tensor, "3"], rows: int, otherwise: float
) -> Float[Tensor, "rows columns"]:
    """Inverse distances of the background in all directions, 1/metres.

    How much they differ between directions is decided by photographs that are set aside: where a person has moved in
    front of the background, or the exposure has changed, distances that fit some photographs are wrong for others.

    Args:
        shots: backgrounds of the photographs.
        centre: from where distances are measured, metres.
        rows: number of directions from pole to pole; twice as many around.
        otherwise: the inverse distance if no two photographs show the same background.
    """
    known, aside = shots[::2], shots[1::2]
    sweep = Sweep.of(known, centre, rows)
    errors = [_error(known, aside, centre, sweep.nearness(weight, otherwise)) for weight in EVERYWHERE]
    good = [weight for weight, error in zip(EVERYWHERE, errors, strict=True) if error <= CHANCE * min(errors)]
    return Sweep.of(shots, centre, rows).nearness(good[-1], otherwise)


@dataclass(frozen=True)
class Sweep:
    """How photographs disagree about the colours of spheres.

    Attributes:
        inverse: inverse radii, 1/metres.
        disagreement: sum over the photographs of their squared differences from their mean, in the surroundings of each
            cell, for each of `AROUND`.
        pairs: photographs that show a cell, less one, in the same surroundings.
        whole: mean disagreement on each sphere; zeros if no photographs meet on any.
        met: for each cell, whether photographs meet there on any sphere.
    """

    inverse: Float[Tensor, " radius"]
    disagreement: Float[Tensor, "around radius rows columns"]
    pairs: Float[Tensor, "around radius rows columns"]
    whole: Float[Tensor, " radius"]
    met: Bool[Tensor, "rows columns"]

    @classmethod
    def of(cls, shots: Sequence[Shot], centre: Float[Tensor, "3"], rows: int) -> "Sweep":
        """Compare photographs."""
        inverse = torch.linspace(1 / FARTHEST, 1 / NEAREST, RADII, device=centre.device)
        found = [_disagreement(shots, centre, rows, float(1 / near)) for near in inverse]
        disagreement, pairs = (torch.stack(parts) for parts in zip(*found, strict=True))
        met = pairs.sum(dim=(1, 2))
        whole = disagreement.sum(dim=(1, 2)) / met.clamp(min=1)
        # Spheres on which no photographs meet tell nothing.
        whole = torch.where(met > 0, whole, whole.max())
        votes, voters = (
            torch.stack([blurred_around(part, sigma) for sigma in AROUND]) for part in (disagreement, pairs)
        )
        return cls(inverse, votes, voters, whole, pairs.sum(dim=0) > 0)

    def nearness(self, everywhere: float, otherwise: float) -> Float[Tensor, "rows columns"]:
        """Inverse distances in all directions.

        Args:
            everywhere: weight of the disagreement on the whole sphere.
            otherwise: the inverse distance if no two photographs show the same background.
        """
        if not self.met.any():
            return torch.full(self.met.shape, otherwise, device=self.met.device)
        whole = everywhere * self.whole[:, None, None]
        cost = ((self.disagreement + whole) / (self.pairs + everywhere)).sum(dim=0)
        best = cost.argmin(dim=0)
        near = self.inverse[best] + (self.inverse[1] - self.inverse[0]) * _between(cost, best)
        # Cells count by how clearly one distance is better than the mean of all; before a plain wall, all count alike.
        clear = LEAST_CLEAR + (cost.mean(dim=0) - cost.amin(dim=0)) / cost.mean(dim=0).clamp(min=TINY)
        weight = torch.where(self.met, clear, 0.0)
        weighted = torch.stack([near * weight, weight])
        total, share = weighted.sum(dim=(1, 2))
        smooth = (total / share.clamp(min=TINY)).expand_as(near)
        for sigma in SMOOTH:
            total, share = blurred_around(weighted, sigma)
            smooth = (total + CONTINUED * smooth) / (share + CONTINUED)
        return smooth


def _error(
    known: Sequence[Shot], aside: Sequence[Shot], centre: Float[Tensor, "3"], nearness: Float[Tensor, "rows columns"]
) -> float:
    """Mean squared difference between the colours that known photographs give a shell and those of others."""
    shell, rows = wrapped(nearness[None]), len(nearness)

    def colours(shots: Sequence[Shot]) -> tuple[Float[Tensor, "cell 3"], Float[Tensor, " cell"]]:
        total, count = centre.new_zeros(2 * rows * rows, 3), centre.new_zeros(2 * rows * rows)
        for shot in shots:
            origin = shot.origin - centre
            reached = origin[:, None, None] + followed_rays(origin, shot.rays, shell) * shot.rays
            cell = _cells(reached / reached.norm(dim=0), rows)
            total.index_add_(0, cell, shot.colours)
            count.index_add_(0, cell, torch.ones_like(shot.colours[:, 0]))
        return total / count.clamp(min=1)[:, None], count

    first, seen = colours(known)
    squares = met = 0.0
    for shot in aside:
        second, also = colours([shot])
        weight = also * (seen > 0)
        squares += float((weight * (first - second).square().sum(dim=1)).sum())
        met += float(weight.sum())
    return squares / met if met > 0 else 0.0


def _disagreement(
    shots: Sequence[Shot], centre: Float[Tensor, "3"], rows: int, radius: float
) -> tuple[Float[Tensor, "rows columns"], Float[Tensor, "rows columns"]]:
    """Variance of the photographs' colours in each cell of a sphere, times their number less one, and that number."""
    cells = 2 * rows * rows
    count, total, squares = centre.new_zeros(cells), centre.new_zeros(cells, 3), centre.new_zeros(cells)
    for shot in shots:
        cell = _cells(sphere_directions(shot.origin - centre, shot.rays, radius), rows)
        # One colour for each photograph and cell, so that detail within a photograph is no disagreement.
        used, place, pixels = torch.unique(cell, return_inverse=True, return_counts=True)
        colour = centre.new_zeros(len(used), 3).index_add_(0, place, shot.colours) / pixels[:, None]
        count[used] += 1
        total[used] += colour
        squares[used] += colour.square().sum(dim=1)
    several = (count - 1).clamp(min=0)
    spread = (squares - total.square().sum(dim=1) / count.clamp(min=1)).clamp(min=0)
    return torch.where(several > 0, spread, 0.0).view(rows, -1), several.view(rows, -1)


def _cells(directions: Float[Tensor, "3 1 pixel"], rows: int) -> Int64[Tensor, " pixel"]:
    """The cell of a sphere in which each direction lies."""
    u, v = equirectangular(directions)
    row, column = ((x[0] * n).long().clamp(max=n - 1) for x, n in ((v, rows), (u, 2 * rows)))
    return row * 2 * rows + column


def _between(
    cost: Float[Tensor, "radius rows columns"], best: Int64[Tensor, "rows columns"]
) -> Float[Tensor, "rows columns"]:
    """Where a parabola through the best radius and those beside it has its minimum, in steps, at most half a step."""
    middle = best.clamp(1, len(cost) - 2)
    low, least, high = (cost.gather(0, (middle + offset)[None])[0] for offset in (-1, 0, 1))
    offset = 0.5 * (low - high) / (low - 2 * least + high).clamp(min=1e-12)
    return torch.where(best == middle, offset.clamp(-0.5, 0.5), 0.0)
