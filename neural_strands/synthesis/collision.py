"""Keeps strands out of the head: pushes points out, then integrates the strand again so that it keeps its length."""

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.geometry.distance_grid import SignedDistanceGrid
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import lengths_along, segments
from neural_strands.synthesis.shorten import shorten

CLEARANCE = 0.0004
"""Least height of strands above the skin once they have left it (m)."""
RISE = 0.3
"""Slope at which the clearance is reached from the root: height over length."""
HEIGHTS = (CLEARANCE, 0.003, 0.007)
"""Heights above the skin (m) that are tried in turn for strands that enter the head."""
TORN = 4.0
"""A segment this many times longer than its strand's median has been torn apart by a correction."""
SHORTEST = 1
"""Fewest points that a strand keeps beyond its root, wherever it enters the head."""
ROUNDS = 4
"""Coarse corrections, each followed by an integration of the whole strand."""
EXACT_ROUNDS = 3
"""Fine corrections against the triangles themselves."""


def keep_outside(
    points: Float[Tensor, "strand point 3"], grid: SignedDistanceGrid, mesh: Mesh
) -> Float[Tensor, "strand point 3"]:
    """Move strands out of the head, points and segments alike; roots stay.

    Strands that still cross a thin part (an ear) are led around it at a larger distance, and end before it if that
    fails too. Arc lengths are preserved except for the last fine correction.
    """
    index = SignedDistanceIndex(mesh)
    result = points.clone()
    entering = torch.arange(len(points), device=points.device)
    for height in HEIGHTS:
        result[entering] = _pushed(points[entering], height, grid, index)
        entering = entering[_first_entry(result[entering], grid, index) < points.shape[1]]
        if len(entering) == 0:
            return result
    last = _first_entry(result[entering], grid, index) - 1
    result[entering] = shorten(result[entering], last.clamp(min=SHORTEST).to(points))
    return result


def integrate_again(
    targets: Float[Tensor, "strand point 3"], lengths: Float[Tensor, "strand point-1"]
) -> Float[Tensor, "strand point 3"]:
    """Follow the targets from the root with segments of given lengths (metres)."""
    points = [targets[:, 0]]
    for index in range(1, targets.shape[1]):
        direction = torch.nn.functional.normalize(targets[:, index] - points[-1], dim=-1)
        points.append(points[-1] + lengths[:, index - 1, None] * direction)
    return torch.stack(points, dim=1)


def _pushed(
    points: Float[Tensor, "strand point 3"], height: float, grid: SignedDistanceGrid, index: SignedDistanceIndex
) -> Float[Tensor, "strand point 3"]:
    """Points pushed to `height` metres above the skin by the grid, then to at least CLEARANCE by the triangles."""
    arc = lengths_along(points)
    result = points.clone()
    for _ in range(ROUNDS):
        distance, outward = grid.with_outward(result)
        missing = ((RISE * arc).clamp(max=height) - distance).clamp(min=0.0)
        missing[:, 0] = 0.0
        hit = (missing > 0.0).any(dim=1)
        if not hit.any():
            break
        pushed = result[hit] + missing[hit][..., None] * outward[hit]
        result[hit] = integrate_again(pushed, segments(result[hit]).norm(dim=-1))
    _lift_exactly(result, (RISE * arc).clamp(max=CLEARANCE), grid, index)
    return result


def _first_entry(
    points: Float[Tensor, "strand point 3"], grid: SignedDistanceGrid, index: SignedDistanceIndex
) -> Int64[Tensor, " strand"]:
    """The end of the first segment that passes through the head, or the number of points."""
    count = points.shape[1]
    middles = (points[:, 1:] + points[:, :-1]) / 2
    step = segments(points).norm(dim=-1)
    enters = step > TORN * step.median(dim=1, keepdim=True).values
    for places in (points[:, 1:], middles):
        doubtful = grid(places) < grid.largest_error
        inside = torch.zeros_like(doubtful)
        if doubtful.any():
            inside[doubtful] = index(places[doubtful]).distance <= 0.0
        enters |= inside
    return torch.where(enters.any(dim=1), enters.int().argmax(dim=1) + 1, count)


def _lift_exactly(
    points: Float[Tensor, "strand point 3"],
    wanted: Float[Tensor, "strand point"],
    grid: SignedDistanceGrid,
    index: SignedDistanceIndex,
) -> None:
    """Lift points that lie too low above the triangles, in place; only points that the grid cannot clear are tested."""
    doubtful = grid(points) < grid.largest_error + wanted
    doubtful[:, 0] = False
    which = torch.nonzero(doubtful)
    for _ in range(EXACT_ROUNDS):
        if len(which) == 0:
            return
        strand, point = which.unbind(dim=1)
        height = wanted[strand, point]
        found = index(points[strand, point])
        low = found.distance < 0.999 * height
        lifted = found.closest + (height[:, None] * 1.02) * found.normal
        which = which[low]
        points[strand[low], point[low]] = lifted[low]
