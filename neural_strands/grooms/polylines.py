"""Joining chains of vertex indices into strands."""

import numpy as np


def join_chains(index: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Join chains that start where the previous one ends.

    Args:
        index: vertex indices of all chains, concatenated.
        counts: number of indices of each chain, at least two.

    Returns:
        The vertex indices of all strands, concatenated, and the number of indices of each strand.
    """
    ends = np.cumsum(counts)
    starts = ends - counts
    goes_on = np.zeros(len(counts), dtype=bool)
    goes_on[1:] = index[starts[1:]] == index[ends[:-1] - 1]
    keep = np.ones(len(index), dtype=bool)
    keep[starts[goes_on]] = False
    strand = np.cumsum(~goes_on) - 1
    sizes = np.bincount(strand, weights=counts - goes_on).astype(np.int64)
    return index[keep], sizes
