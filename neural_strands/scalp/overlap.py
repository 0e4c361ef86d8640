"""Finds faces of a chart that overlap: a texel may belong to only one position on the scalp."""

import numpy as np
from jaxtyping import Float, Int64
from torch import Tensor, from_numpy

SLACK = 1e-6
"""Depth in uv up to which neighbours may overlap because of rounding in files."""

PAIRS_AT_ONCE = 2_000_000


def overlapping_faces(uv: Float[Tensor, "face 3 2"]) -> Int64[Tensor, "pair 2"]:
    """Pairs of faces whose interiors overlap in the chart by more than `SLACK`, whatever their orientation."""
    corners = uv.detach().cpu().double().numpy()
    low, high = corners.min(axis=1), corners.max(axis=1)
    order = np.argsort(low[:, 0], kind="stable")
    low, high, corners = low[order], high[order], corners[order]
    # Sweep along u: each face is compared with those that start before it ends.
    ends = np.searchsorted(low[:, 0], high[:, 0] - SLACK)
    counts = np.maximum(ends - np.arange(len(corners)) - 1, 0)
    found = []
    for chunk in _chunks(counts):
        first = np.repeat(chunk, counts[chunk])
        start = np.repeat(np.cumsum(counts[chunk]) - counts[chunk], counts[chunk])
        second = first + 1 + np.arange(len(first)) - start
        near = (low[first, 1] < high[second, 1] - SLACK) & (low[second, 1] < high[first, 1] - SLACK)
        first, second = first[near], second[near]
        hit = _overlap(corners[first], corners[second])
        found.append(np.stack([order[first[hit]], order[second[hit]]], axis=1))
    pairs = np.sort(np.concatenate(found), axis=1) if found else np.zeros((0, 2), dtype=np.int64)
    return from_numpy(pairs[np.lexsort(pairs.T[::-1])])


def _chunks(counts: np.ndarray) -> list[np.ndarray]:
    """Split faces into groups with a bounded number of pairs."""
    run = np.cumsum(counts) // PAIRS_AT_ONCE
    return np.split(np.arange(len(counts)), np.flatnonzero(np.diff(run)) + 1)


def _overlap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether two triangles overlap, by the six axes that could separate them."""
    separated = np.zeros(len(a), bool)
    for one, other in ((a, b), (b, a)):
        for corner in range(3):
            edge = one[:, (corner + 1) % 3] - one[:, corner]
            axis = np.stack([-edge[:, 1], edge[:, 0]], axis=1)
            axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-300)
            mine = np.einsum("nck,nk->nc", one, axis)
            theirs = np.einsum("nck,nk->nc", other, axis)
            reach = np.minimum(mine.max(axis=1), theirs.max(axis=1)) - np.maximum(mine.min(axis=1), theirs.min(axis=1))
            separated |= reach <= SLACK
    return ~separated
