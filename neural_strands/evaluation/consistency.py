"""Strand consistency (HairGS): the share of each true strand that a single predicted strand matches."""

import math
from collections.abc import Sequence

import torch
import warp as wp

from neural_strands.evaluation.kernels.consistency import consistency_kernel
from neural_strands.evaluation.oriented_points import OrientedPoints
from neural_strands.foundation.kernels import array, launch_split
from neural_strands.geometry.kernels.point_queries import MOST_LEVELS, LevelVector
from neural_strands.geometry.point_grid import PointGrid
from neural_strands.geometry.point_queries import check_thresholds

MOST_CANDIDATES = 4096
"""Predicted strands counted for one true strand; if there are more, those met first along the strand count."""
SCRATCH_BYTES = 64 * 1024**2
"""Memory for the counters of the true strands processed together."""


def consistency(
    predicted: OrientedPoints, truth: OrientedPoints, thresholds: Sequence[tuple[float, float]]
) -> list[float]:
    """Mean over true strands of the largest share of its points that one predicted strand matches, in [0, 1].

    A predicted strand matches a point if one of its points lies within a threshold's distance and its direction
    (unsigned) within the threshold's angle.

    Args:
        predicted: samples of the predicted strands.
        truth: samples of the true strands.
        thresholds: (distance in metres, angle in radians) from strict to lax; neither may decrease.

    Returns:
        One mean for each threshold.

    Raises:
        ValueError: the thresholds do not grow, or there are more than eight.
    """
    check_thresholds(thresholds)
    levels = len(thresholds)
    if len(truth) == 0 or len(predicted) == 0:
        return [0.0] * levels
    device = truth.points.device
    curves, sizes = torch.unique_consecutive(truth.curve, return_counts=True)
    ends = sizes.cumsum(0).int()
    offsets = torch.cat([ends.new_zeros(1), ends])
    grid = PointGrid.build(predicted.points, thresholds[-1][0])
    strands = int(predicted.curve.max()) + 1
    slots = 1 << min(max(2 * strands - 1, 15).bit_length(), MOST_CANDIDATES.bit_length() - 1)
    best = torch.zeros(len(curves), levels, dtype=torch.int32, device=device)
    padding = [0.0] * (MOST_LEVELS - levels)
    inputs = [
        *grid.kernel_inputs(),
        array(grid.sorted_values(predicted.directions), wp.vec3),
        array(grid.sorted_values(predicted.curve.int())),
        array(truth.points, wp.vec3),
        array(truth.directions, wp.vec3),
        LevelVector(*[distance for distance, _ in thresholds], *padding),
        LevelVector(*[math.cos(angle) for _, angle in thresholds], *padding),
        levels,
        slots,
    ]
    numbers = 1 + 2 * levels
    chunk = max(1, SCRATCH_BYTES // (4 * numbers * slots))
    for start in range(0, len(curves), chunk):
        part = offsets[start : start + chunk + 1]
        result = best[start : start + chunk]
        scratch = torch.zeros(len(result), slots, numbers, dtype=torch.int32, device=device)
        launch_split(consistency_kernel, len(result), [*inputs, array(part), array(scratch), array(result)], device)
    return (best / sizes[:, None]).double().mean(dim=0).tolist()


def consistency_reference(predicted: OrientedPoints, truth: OrientedPoints, distance: float, angle: float) -> float:
    """`consistency` at one threshold by brute force, for tests: every true point against every predicted one."""
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
