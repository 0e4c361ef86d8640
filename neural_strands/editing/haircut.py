"""A haircut: strands end where they reach a length, a share of their length, or the border of a shape.

The remaining part of a strand keeps its parameter t and width at every position. The renderer therefore looks up the
appearance learned for those positions, and a cut end keeps its thickness instead of tapering.
"""

import math
from dataclasses import replace
from pathlib import Path

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.kernels.shorten import spread_points, sum_lengths
from neural_strands.editing.region import strand_weight
from neural_strands.editing.settings import SHORTEST, WAYS, Haircut
from neural_strands.foundation import kernels
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.mesh_file import read_mesh_file

LOCK = 0.02
"""Size of the locks in which an uneven edge varies, metres."""
REMEDIES = {
    "length": "give a longer one",
    "fraction": "give a smaller one",
    "plane": "move it or turn it round",
    "box": "move or enlarge it",
    "mesh": "move or enlarge it",
}
"""Advice on a haircut that would leave no hair, for each of `WAYS`."""
POINTS_AT_ONCE = 2**20
"""Number of points whose distance to a mesh is computed together, to bound memory."""


def cut_hair(haircut: Haircut, strands: Strands) -> Strands:
    """Cut strands; those that are cut off completely are dropped.

    Raises:
        InputError: no hair would remain, the painted region is empty, or the mesh cannot be read.
    """
    weight = strand_weight(strands, haircut.region, "haircut")
    arc = arc_lengths(strands.points)
    whole = arc[:, -1]
    limit = _limit(haircut, strands, arc) - haircut.uneven * ragged(strands.points[:, 0], haircut.seed)
    kept = torch.lerp(whole, limit.clamp(min=0.0).minimum(whole), weight)
    remain = kept >= whole.clamp(max=SHORTEST)
    if not remain.any():
        way = next(name for name in WAYS if getattr(haircut, name) is not None)
        raise InputError(
            f"haircut: expected hair to remain, found that the {way} cuts off all {len(strands):,} strands; "
            f"{REMEDIES[way]}."
        )
    if not remain.all():
        strands, kept, arc = strands.select(remain), kept[remain], arc[remain]
    return shortened(strands, kept, arc)


def _limit(haircut: Haircut, strands: Strands, arc: Float[Tensor, "strand point"]) -> Float[Tensor, " strand"]:
    """Length at which each strand ends, metres; infinite if it is not cut."""
    if haircut.length is not None:
        return arc.new_full((len(strands),), haircut.length)
    if haircut.fraction is not None:
        return (1 - haircut.fraction) * arc[:, -1]
    return first_crossing(_outside(haircut, strands.points), arc)


def _outside(haircut: Haircut, points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
    """Distance of every point outside the shape, metres; negative inside."""
    if haircut.plane is not None:
        origin, normal = points.new_tensor(haircut.plane).reshape(2, 3)
        normal = torch.nn.functional.normalize(normal, dim=0)
        return points @ normal - origin @ normal
    if haircut.box is not None:
        corners = points.new_tensor(haircut.box).reshape(2, 3)
        return torch.maximum(corners.amin(dim=0) - points, points - corners.amax(dim=0)).amax(dim=-1)
    assert haircut.mesh is not None
    shape = SignedDistanceIndex(read_mesh_file(Path(haircut.mesh)).mesh.to(points.device))
    flat = points.reshape(-1, 3)
    return torch.cat([shape(part).distance for part in flat.split(POINTS_AT_ONCE)]).reshape(points.shape[:2])


def arc_lengths(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
    """Arc length from the root to every point, metres."""
    arc = kernels.zeros(points.shape[:2], torch.float32, points.device)
    inputs = [kernels.array(points.float(), wp.vec3), kernels.array(arc)]
    kernels.launch_split(sum_lengths, len(points), inputs, points.device)
    return arc


def first_crossing(
    outside: Float[Tensor, "strand point"], arc: Float[Tensor, "strand point"]
) -> Float[Tensor, " strand"]:
    """Arc length at which each strand first leaves a shape; infinite if it never does.

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
    """Shorten strands to a given arc length, keeping the number of points.

    The points move along the polyline, evenly in its own numbering of points; t and width are interpolated there.

    Args:
        strands: the strands to shorten.
        kept: remaining length, metres; larger values change nothing.
        arc: `arc_lengths` of the strands, if the caller has them already.
    """
    arc = arc_lengths(strands.points) if arc is None else arc
    count = strands.points_per_strand
    end = torch.searchsorted(arc, kept[:, None], right=True).clamp(1, count - 1)
    low, high = arc.gather(1, end - 1), arc.gather(1, end)
    last = (end - 1) + ((kept[:, None] - low) / (high - low).clamp(min=1e-12)).clamp(0, 1)
    t, width = strands.parameters(), strands.width
    # For strands without widths, pass t in place of the width and ignore the result.
    given = (strands.points, t, t if width is None else width)
    found = [kernels.zeros(each.shape, torch.float32, each.device) for each in given]
    inputs = [
        kernels.array(last[:, 0]),
        *(kernels.array(each.float(), wp.vec3 if each.ndim == 3 else None) for each in (*given, *found)),
    ]
    kernels.launch_split(spread_points, len(strands), inputs, last.device)
    return replace(strands, points=found[0], t=found[1], width=None if width is None else found[2])


def ragged(roots: Float[Tensor, "strand 3"], seed: int) -> Float[Tensor, " strand"]:
    """Random numbers in [0, 1] for an uneven edge: half the mean of one per strand and one per lock."""
    random = torch.Generator().manual_seed(seed)
    waves = torch.nn.functional.normalize(torch.randn(3, 4, generator=random), dim=0) * (2 * math.pi / LOCK)
    phase = 2 * math.pi * torch.rand(4, generator=random)
    own = torch.rand(len(roots), generator=random).to(roots)
    lock = 0.5 + 0.5 * torch.sin(roots @ waves.to(roots) + phase.to(roots)).mean(dim=1)
    return 0.5 * (own + lock)
