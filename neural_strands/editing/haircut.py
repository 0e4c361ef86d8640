"""A haircut: strands end where they reach a length, a share of their length, or the border of a shape.

What remains of a strand keeps the parameter t and the width of every place on it. The renderer therefore finds the
appearance that it learned for those places, and a cut end keeps its thickness instead of tapering.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.edit import StrandEdit
from neural_strands.editing.region import Dabs, strand_weight
from neural_strands.foundation.configs import Between
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import Strands, segments
from neural_strands.scalp.mesh_file import read_mesh_file

Place = Annotated[float, Between(-1000.0, 1000.0)]
"""A coordinate in world metres."""
LEAST = 0.001
"""Length below which nothing remains of a strand, metres."""
LOCK = 0.02
"""Size of the locks in which an uneven edge varies, metres."""
WAYS = ("length", "fraction", "plane", "box", "mesh")
"""The settings that say where strands end; a haircut has one of them."""
POINTS_AT_ONCE = 2**20
"""Points whose distance to a mesh is found together; bounds memory."""


@dataclass(frozen=True)
class Haircut(StrandEdit):
    """Cut strands to a length, by a fraction of their length, or where they leave a half-space, a box or a mesh.

    A strand is cut where it first leaves the shape, seen from its root; one whose root lies outside is removed.
    """

    length: Annotated[float, Between(LEAST, 10.0)] | None = None
    """Longest strand that remains, metres."""
    fraction: Annotated[float, Between(0.0, 1.0)] | None = None
    """Share of every strand that is cut off, from 0 to 1."""
    plane: tuple[Place, Place, Place, Place, Place, Place] | None = None
    """A point of a plane and its normal (x y z, metres): what lies on the side of the normal is cut."""
    box: tuple[Place, Place, Place, Place, Place, Place] | None = None
    """Two opposite corners of a box (x y z, metres): what lies outside is cut."""
    mesh: str | None = None
    """File of a closed mesh in world metres: what lies outside is cut."""
    uneven: Annotated[float, Between(0.0, 0.1)] = 0.003
    """By how much strands may be cut shorter than told, metres, so that the edge looks cut by hand."""
    region: Dabs = ()
    """Dabs on the scalp chart (u, v, radius); without any, the whole scalp is cut."""
    seed: int = 0
    """Seed of the uneven edge."""

    def __post_init__(self) -> None:
        given = [name for name in WAYS if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f"haircut: expected one of {', '.join(WAYS)}, found {' and '.join(given) or 'none'}; give one."
            )
        if self.plane is not None and math.hypot(*self.plane[3:]) < 1e-6:
            raise InputError("haircut: expected a plane's normal with a length, found zeros; give a direction.")

    def edited(self, strands: Strands) -> Strands:
        """Cut the strands; those of which nothing remains are dropped.

        Raises:
            InputError: no hair would remain, the painted region is empty, or the mesh cannot be read.
        """
        weight = strand_weight(strands, self.region, "haircut")
        arc = arc_lengths(strands.points)
        whole = arc[:, -1]
        limit = self._limit(strands, arc) - self.uneven * ragged(strands.points[:, 0], self.seed)
        kept = torch.minimum(whole, torch.lerp(whole, limit.clamp(min=0.0).minimum(whole), weight))
        remain = kept >= torch.minimum(whole, whole.new_tensor(LEAST))
        if not remain.any():
            way = next(name for name in WAYS if getattr(self, name) is not None)
            raise InputError(
                f"haircut: expected hair to remain, found that the {way} cuts off all {len(strands)} strands; move or "
                "enlarge it."
            )
        return shortened(strands.select(remain), kept[remain], arc[remain])

    def _limit(self, strands: Strands, arc: Float[Tensor, "strand point"]) -> Float[Tensor, " strand"]:
        """Length at which each strand ends, metres; infinite where the shape does not cut it."""
        if self.length is not None:
            return arc.new_full((len(strands),), self.length)
        if self.fraction is not None:
            return (1 - self.fraction) * arc[:, -1]
        return first_crossing(self._outside(strands.points), arc)

    def _outside(self, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
        """Distance of every point outside the shape, metres; negative inside."""
        if self.plane is not None:
            origin, normal = points.new_tensor(self.plane).reshape(2, 3)
            normal = torch.nn.functional.normalize(normal, dim=0)
            return points @ normal - origin @ normal
        if self.box is not None:
            corners = points.new_tensor(self.box).reshape(2, 3)
            return torch.maximum(corners.amin(dim=0) - points, points - corners.amax(dim=0)).amax(dim=-1)
        assert self.mesh is not None
        shape = SignedDistanceIndex(read_mesh_file(Path(self.mesh)).mesh.to(points.device))
        flat = points.reshape(-1, 3)
        return torch.cat([shape(part).distance for part in flat.split(POINTS_AT_ONCE)]).reshape(points.shape[:2])


def arc_lengths(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
    """Arc length from the root to every point, metres."""
    return torch.nn.functional.pad(segments(points).norm(dim=-1).cumsum(dim=1), (1, 0))


def first_crossing(
    outside: Float[Tensor, "strand point"], arc: Float[Tensor, "strand point"]
) -> Float[Tensor, " strand"]:
    """Arc length at which each strand first leaves a shape; infinite where it never does.

    Args:
        outside: signed distance of every point, positive outside the shape.
        arc: arc length of every point.
    """
    out = outside > 0
    after = out.float().argmax(dim=1)
    before = (after - 1).clamp(min=0)
    ends = [values.gather(1, index[:, None])[:, 0] for values in (outside, arc) for index in (before, after)]
    out_before, out_after, arc_before, arc_after = ends
    share = (-out_before / (out_after - out_before).clamp(min=1e-12)).clamp(0, 1)
    crossing = torch.where(after > 0, torch.lerp(arc_before, arc_after, share), 0.0)
    return torch.where(out.any(dim=1), crossing, math.inf)


def shortened(
    strands: Strands, kept: Float[Tensor, " strand"], arc: Float[Tensor, "strand point"] | None = None
) -> Strands:
    """Strands that end at a given arc length, with as many points as before.

    The points move along the polyline, evenly in its own numbering of points; t and width are taken where they come to
    lie.

    Args:
        strands: to cut.
        kept: length that remains, metres; a longer one changes nothing.
        arc: `arc_lengths` of the strands, if it is known.
    """
    arc = arc_lengths(strands.points) if arc is None else arc
    count = strands.points_per_strand
    end = torch.searchsorted(arc, kept[:, None], right=True).clamp(1, count - 1)
    low, high = arc.gather(1, end - 1), arc.gather(1, end)
    last = (end - 1) + ((kept[:, None] - low) / (high - low).clamp(min=1e-12)).clamp(0, 1)
    place = last * torch.linspace(0, 1, count, dtype=last.dtype, device=last.device)
    whole = place.long().clamp(max=count - 2)
    fraction = (place - whole)[..., None]

    def at(values: Float[Tensor, "strand point channel"]) -> Float[Tensor, "strand point channel"]:
        """Values at the new places of the points."""
        channels = values.shape[2]
        index = (whole + count * torch.arange(len(values), device=whole.device)[:, None]).flatten()
        flat = values.reshape(-1, channels)
        ends = flat.index_select(0, index), flat.index_select(0, index + 1)
        return torch.lerp(*ends, fraction.reshape(-1, 1).to(values)).view(-1, count, channels)

    width = None if strands.width is None else at(strands.width[..., None])[..., 0]
    return replace(strands, points=at(strands.points), t=at(strands.parameters()[..., None])[..., 0], width=width)


def ragged(roots: Float[Tensor, "strand 3"], seed: int) -> Float[Tensor, " strand"]:
    """Numbers in [0, 1] by which an edge varies: half of each strand's own, half shared by its lock."""
    random = torch.Generator().manual_seed(seed)
    waves = torch.nn.functional.normalize(torch.randn(3, 4, generator=random), dim=0) * (2 * math.pi / LOCK)
    phase = 2 * math.pi * torch.rand(4, generator=random)
    own = torch.rand(len(roots), generator=random).to(roots)
    lock = 0.5 + 0.5 * torch.sin(roots @ waves.to(roots) + phase.to(roots)).mean(dim=1)
    return 0.5 * (own + lock)
