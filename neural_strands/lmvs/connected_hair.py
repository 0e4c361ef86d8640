"""Separates hair from clutter without masks: hair forms large connected masses, and isolated specks are not hair."""

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from neural_strands.geometry.line_segments import LineSegments


def large_masses(segments: LineSegments, cell: float, share: float) -> LineSegments:
    """Keep segments in large masses: points belong to one mass if their cells of `cell` metres touch.

    Args:
        segments: chains whose neighbouring points are nearer than a cell, so that no chain is cut.
        cell: edge of a cell, metres.
        share: masses with less than this share of the largest one's points are dropped.
    """
    if len(segments) == 0:
        return segments
    index = torch.floor(segments.points / cell).long().cpu()
    cells, inverse = torch.unique(index, dim=0, return_inverse=True)
    # Touching cells, even at a corner, are at most sqrt(3) apart.
    pairs = KDTree(cells.numpy()).query_pairs(1.8, output_type="ndarray")
    touching = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(cells), len(cells)))
    mass = torch.from_numpy(connected_components(touching, directed=False)[1]).long()[inverse]
    size = torch.bincount(mass)
    return segments.select((size >= share * size.max())[mass].to(segments.points.device))
