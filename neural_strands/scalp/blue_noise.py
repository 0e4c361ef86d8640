"""Blue noise by parallel sample elimination: an exact number of points, none much closer than the others.

A maximal set of dart throws first leaves slightly more points than required, none closer than a radius; weighted sample
elimination (Yuksel 2015) then removes the surplus where points are most crowded. Both process whole independent sets at
once, so that numpy is fast enough. Candidates must be in random order: their order is their priority.
"""

import math

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.spatial import KDTree
from torch import Tensor

DART_RADIUS = 0.61
"""Radius of the dart throws over the largest possible one; leaves about 7% more points than required."""

SHRINK = 0.93
"""Factor on the radius if too few darts fit."""

BATCH = 0.25
"""Share of the surplus removed in one round; the weights change between rounds."""

REACH = 1.5
"""Distance up to which neighbours count, over the largest possible; beyond, their weight is negligible."""

EXPONENT = 8
"""Power of Yuksel's weight function."""


def eliminate(points: Float[Tensor, "candidate 3"], count: int, area: float) -> Int64[Tensor, " kept"]:
    """Indices of exactly `count` of `points`, spread as blue noise.

    Args:
        points: candidates, uniform over a surface, several times `count`, in random order.
        count: number of points to keep, at most as many as there are.
        area: area of the surface, square metres.
    """
    positions = points.detach().cpu().double().numpy()
    # The densest packing of the plane is hexagonal: distance sqrt(2 A / (sqrt(3) n)).
    largest = math.sqrt(2.0 * area / (math.sqrt(3.0) * count))
    radius = DART_RADIUS * largest
    kept = _throw_darts(positions, radius)
    while len(kept) < count:
        radius *= SHRINK
        kept = _throw_darts(positions, radius) if radius > 1e-3 * largest else np.arange(len(positions))
    return torch.from_numpy(kept[_remove_crowded(positions[kept], len(kept) - count, largest)])


def throw_darts(points: Float[Tensor, "candidate 3"], radius: float) -> Int64[Tensor, " kept"]:
    """Indices of a maximal subset with no two points closer than `radius`; earlier points come first.

    Args:
        points: candidates, in the order of their priority.
        radius: smallest distance, metres.
    """
    return torch.from_numpy(_throw_darts(points.detach().cpu().double().numpy(), radius)).to(points.device)


def _throw_darts(positions: np.ndarray, radius: float) -> np.ndarray:
    """Mark a maximal subset with no two points closer than `radius`, the same one as throwing them one by one."""
    pairs = KDTree(positions).query_pairs(radius, output_type="ndarray")
    winner, loser = pairs.T
    undecided = np.ones(len(positions), bool)
    taken = np.zeros(len(positions), bool)
    while undecided.any():
        beaten = np.zeros(len(positions), bool)
        beaten[loser] = True
        accepted = undecided & ~beaten
        taken |= accepted
        undecided &= ~accepted
        removed = np.zeros(len(positions), bool)
        removed[loser[accepted[winner]]] = True
        undecided &= ~removed
        alive = undecided[winner] & undecided[loser]
        winner, loser = winner[alive], loser[alive]
    return np.flatnonzero(taken)


def _remove_crowded(positions: np.ndarray, surplus: int, largest: float) -> np.ndarray:
    """Remove `surplus` points, always those with the greatest weight among their neighbours; returns the rest."""
    alive = np.ones(len(positions), bool)
    if surplus == 0:
        return np.flatnonzero(alive)
    reach = REACH * largest
    pairs = KDTree(positions).query_pairs(reach, output_type="ndarray")
    first, second = np.concatenate([pairs, pairs[:, ::-1]]).T
    gap = np.linalg.norm(positions[first] - positions[second], axis=1)
    share = (1.0 - gap / reach) ** EXPONENT
    while surplus > 0:
        weight = np.bincount(first, share, len(positions))
        crowded = alive.copy()
        # Of equal weights the higher index is removed, so that neighbours are never removed together.
        lower = (weight[first] < weight[second]) | ((weight[first] == weight[second]) & (first < second))
        crowded[first[lower]] = False
        leaving = np.flatnonzero(crowded)
        leaving = leaving[np.argsort(-weight[leaving], kind="stable")][: math.ceil(surplus * BATCH)]
        alive[leaving] = False
        surplus -= len(leaving)
        linked = alive[first] & alive[second]
        first, second, share = first[linked], second[linked], share[linked]
    return np.flatnonzero(alive)
