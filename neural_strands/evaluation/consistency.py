"""Strand consistency (HairGS): the share of each true strand that a single predicted strand matches."""

import math

import torch
import warp as wp
from jaxtyping import Int32
from torch import Tensor

from neural_strands.evaluation.kernels.consistency import consistency_kernel
from neural_strands.evaluation.oriented_points import OrientedPoints
from neural_strands.foundation.kernels import array, launch_split
from neural_strands.geometry.point_grid import PointGrid

MOST_CANDIDATES = 4096
"""Predicted strands counted for one true strand; if there are more, those met first along the strand count."""
SCRATCH_BYTES = 64 * 1024**2
"""Memory for the counters of the true strands processed together."""


def consistency(predicted: OrientedPoints, truth: OrientedPoints, distance: float, angle: float) -> float:
    """Mean over true strands of the largest share of its points that one predicted strand matches, in [0, 1].

    A predicted strand matches a point if one of its points lies within `distance` metres and its direction (unsigned)
    within `angle` radians.
    """
    if len(truth) == 0 or len(predicted) == 0:
        return 0.0
    device = truth.points.device
    curves, sizes = torch.unique_consecutive(truth.curve, return_counts=True)
    ends = sizes.cumsum(0).int()
    offsets = torch.cat([ends.new_zeros(1), ends])
    grid = PointGrid.build(predicted.points, distance)
    strands = int(predicted.curve.max()) + 1
    slots = 1 << min(max(2 * strands - 1, 15).bit_length(), MOST_CANDIDATES.bit_length() - 1)
    best = torch.zeros(len(curves), dtype=torch.int32, device=device)
    inputs = [
        *grid.kernel_inputs(),
        array(grid.sorted_values(predicted.directions), wp.vec3),
        array(grid.sorted_values(predicted.curve.int())),
        array(truth.points, wp.vec3),
        array(truth.directions, wp.vec3),
        distance,
        math.cos(angle),
        slots,
    ]
    chunk = max(1, SCRATCH_BYTES // (12 * slots))
    for start in range(0, len(curves), chunk):
        part = offsets[start : start + chunk + 1]
        result = best[start : start + chunk]
        scratch: Int32[Tensor, "strand slot 3"] = torch.zeros(len(result), slots, 3, dtype=torch.int32, device=device)
        launch_split(consistency_kernel, len(result), [*inputs, array(part), array(scratch), array(result)], device)
    return float((best / sizes).double().mean())


def consistency_reference(predicted: OrientedPoints, truth: OrientedPoints, distance: float, angle: float) -> float:
    """`consistency` by brute force, for tests: every true point against every predicted one."""
    if len(truth) == 0 or len(predicted) == 0:
        return 0.0
    shares = []
    for curve in truth.curve.unique().tolist():
        mine = truth.curve == curve
        near = (truth.points[mine, None] - predicted.points).norm(dim=-1) <= distance
        alike = (truth.directions[mine] @ predicted.directions.T).abs() >= math.cos(angle)
        hits = [(near & alike)[:, predicted.curve == other].any(dim=1).sum() for other in predicted.curve.unique()]
        shares.append(float(max(hits)) / int(mine.sum()))
    return sum(shares) / len(shares)
