"""Cuts any set of triangles into disks that can be charted."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

FILL_WEIGHT = 0.01
"""Weight of the triangles that fill a hole: enough to keep it open, too little to distort the real ones."""


@dataclass(frozen=True)
class Patch:
    """A topological disk.

    Attributes:
        faces: (face,) indices of the given faces.
        triangles: (triangle, 3) vertex indices into `positions`: the faces in order, then the fans that fill holes.
        positions: (vertex, 3) in metres; a vertex at which sheets only touch appears once per sheet.
        boundary: (outline,) vertex indices of the outline, counter-clockwise.
        weights: (triangle,) 1 for faces, `FILL_WEIGHT` for fans.
    """

    faces: np.ndarray
    triangles: np.ndarray
    positions: np.ndarray
    boundary: np.ndarray
    weights: np.ndarray


def pieces(faces: np.ndarray) -> list[np.ndarray]:
    """Indices of the faces of each piece, connected across edges of exactly two consistently oriented faces."""
    first, second = _links(faces)
    count = len(faces)
    graph = coo_matrix((np.ones(len(first)), (first // 3, second // 3)), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(order, np.cumsum(np.bincount(label, minlength=number))[:-1])


def disk(positions: np.ndarray, faces: np.ndarray, chosen: np.ndarray) -> Patch | None:
    """Turn `faces[chosen]` into a disk with its holes filled; None if it cannot be one (closed, or with a handle).

    Args:
        positions: (vertex, 3) of the whole mesh.
        faces: (face, 3) vertex indices.
        chosen: indices of one of `pieces(faces)`.
    """
    triangles, source = _split_vertices(faces[chosen])
    local = positions[source]
    loops = _boundary_loops(triangles)
    if not loops:
        return None
    outer = max(range(len(loops)), key=lambda i: _length(local[loops[i]]))
    # A slit of two edges between the same two vertices needs no filling.
    holes = [loop for i, loop in enumerate(loops) if i != outer and len(loop) > 2]
    filled, extra = [triangles], [local]
    for hole in holes:
        centre = len(local) + len(extra) - 1
        filled.append(np.stack([np.roll(hole, -1), hole, np.full(len(hole), centre)], axis=1))
        extra.append(local[hole].mean(axis=0, keepdims=True))
    everything, vertices = np.concatenate(filled), np.concatenate(extra)
    edges = np.sort(np.concatenate([everything[:, [0, 1]], everything[:, [1, 2]], everything[:, [2, 0]]]), axis=1)
    if len(vertices) - len(np.unique(edges, axis=0)) + len(everything) != 1:
        return None
    weights = np.where(np.arange(len(everything)) < len(triangles), 1.0, FILL_WEIGHT)
    return Patch(chosen, everything, vertices, loops[outer], weights)


def bisect(positions: np.ndarray, faces: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split faces in two halves across the longest axis of their centres."""
    centres = positions[faces[chosen]].mean(axis=1)
    axis = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=False)[2][0]
    order = np.argsort((centres - centres.mean(axis=0)) @ axis, kind="stable")
    return chosen[order[: len(order) // 2]], chosen[order[len(order) // 2 :]]


def _links(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of opposite half-edges (3 * face + corner) along edges of exactly two faces."""
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    low, high = np.minimum(start, end), np.maximum(start, end)
    _, edge, count = np.unique(low * (faces.max() + 1) + high, return_inverse=True, return_counts=True)
    order = np.argsort(edge, kind="stable")
    order = order[count[edge[order]] == 2]
    first, second = order[0::2], order[1::2]
    opposed = start[first] == end[second]
    return first[opposed], second[opposed]


def _split_vertices(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Renumber corners so that one vertex stands for one fan of linked faces; returns triangles and old indices."""
    first, second = _links(faces)
    size = 3 * len(faces)
    turn = np.arange(size).reshape(-1, 3)
    following = np.roll(turn, -1, axis=1).reshape(-1)
    # Half-edges of a pair are opposite: the start of one is the end of the other.
    rows = np.concatenate([first, following[first]])
    columns = np.concatenate([following[second], second])
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(size, size))
    count, label = connected_components(graph, directed=False)
    source = np.zeros(count, dtype=np.int64)
    source[label] = faces.reshape(-1)
    return label.astype(np.int64).reshape(-1, 3), source


def _boundary_loops(triangles: np.ndarray) -> list[np.ndarray]:
    """Vertex cycles along half-edges without a partner, with the surface to their left."""
    first, second = _links(triangles)
    start, end = triangles.reshape(-1), np.roll(triangles, -1, axis=1).reshape(-1)
    open_edges = np.setdiff1d(np.arange(len(start)), np.concatenate([first, second]))
    following = dict(zip(start[open_edges].tolist(), end[open_edges].tolist(), strict=True))
    loops = []
    while following:
        vertex = next(iter(following))
        loop = []
        while vertex in following:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops


def _length(points: np.ndarray) -> float:
    return float(np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum())
