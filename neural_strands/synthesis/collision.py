"""Keeping strands out of the head: push points out, then integrate the strand again so that it keeps its length."""

import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.signed_distance import SignedDistanceIndex
from neural_strands.geometry.strands import segments
from neural_strands.synthesis.distance_grid import LARGEST_ERROR, DistanceGrid

CLEARANCE = 0.0004
"""Least height of strands above the skin once they have left it (m)."""
RISE = 0.3
"""How fast the clearance is reached from the root: height over length."""
ROUNDS = 4
"""Coarse corrections, each followed by an integration of the whole strand."""
EXACT_ROUNDS = 3
"""Fine corrections against the triangles themselves."""


def keep_outside(
    points: Float[Tensor, "strand point 3"], grid: DistanceGrid, mesh: Mesh
) -> Float[Tensor, "strand point 3"]:
    """Move strands out of the head; roots stay, and arc lengths are kept up to the last fine correction."""
    wanted = _clearance(points)
    result = points.clone()
    for _ in range(ROUNDS):
        distance, outward = grid.sample(result)
        missing = (wanted - distance).clamp(min=0.0)
        missing[:, 0] = 0.0
        hit = (missing > 0.0).any(dim=1)
        if not hit.any():
            break
        pushed = result[hit] + missing[hit][..., None] * outward[hit]
        result[hit] = integrate_again(pushed, segments(result[hit]).norm(dim=-1))
    _lift_exactly(result, wanted, grid, SignedDistanceIndex(mesh))
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


def _clearance(points: Float[Tensor, "strand point 3"]) -> Float[Tensor, "strand point"]:
    arc = segments(points).norm(dim=-1).cumsum(dim=-1)
    return torch.nn.functional.pad((RISE * arc).clamp(max=CLEARANCE), (1, 0))


def _lift_exactly(
    points: Float[Tensor, "strand point 3"],
    wanted: Float[Tensor, "strand point"],
    grid: DistanceGrid,
    index: SignedDistanceIndex,
) -> None:
    """Lift points that lie too low above the triangles, in place; only those that the grid cannot clear are asked."""
    doubtful = grid.sample(points)[0] < LARGEST_ERROR + wanted
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
