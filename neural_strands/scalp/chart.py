"""Computes scalp charts without overlaps, for any set of faces.

Each piece of the scalp is turned into a disk (holes are filled with fans of triangles) and mapped to a circle by
Tutte's embedding, which cannot overlap. `chart_relax` then relaxes it towards equal lengths; its steps never flip a
triangle or let the outline cross itself, so the chart stays injective. Finally the pieces are rotated so that u runs
along world +x, scaled to their true area and packed on shelves.
"""

import math
from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import splu

from neural_strands.geometry.mesh import Mesh
from neural_strands.scalp.chart_relax import relax
from neural_strands.scalp.patches import Patch, bisect, disk, pieces

MARGIN = 0.02
"""Free border of the chart, and gap between islands, in uv."""


def chart_faces(mesh: Mesh, faces: Int64[torch.Tensor, " scalp"]) -> Float[torch.Tensor, "scalp 3 2"]:
    """Chart the given faces of `mesh`: uv of their corners in [0, 1], without overlaps.

    Pieces that cannot be flattened as a whole (closed, with a handle, or with edges shared by three faces) are cut.
    """
    vertices = mesh.vertices.detach().cpu().double().numpy()
    chosen = mesh.faces[faces].cpu().numpy()
    uv = np.zeros((len(chosen), 3, 2))
    flat = list(_flat_pieces(vertices, chosen))
    for (part, _), placed in zip(flat, _pack([corners for _, corners in flat]), strict=True):
        uv[part] = placed
    return torch.from_numpy(uv).to(mesh.vertices)


def _flat_pieces(vertices: np.ndarray, faces: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield face indices and flat corners (face, 3, 2) in metres, piece by piece."""
    waiting = [(np.arange(len(faces)))]
    while waiting:
        part = waiting.pop()
        for piece in pieces(faces[part]):
            chosen = part[piece]
            patch = disk(vertices, faces, chosen)
            flat = None if patch is None else _flatten(patch)
            if flat is None:
                waiting.extend(bisect(vertices, faces, chosen))
            else:
                yield chosen, flat @ _upright(vertices[faces[chosen]], flat)


def _flatten(patch: Patch) -> np.ndarray | None:
    """Injective flat corners (face, 3, 2) in metres; None if Tutte's embedding degenerates."""
    start = tutte_embedding(patch.triangles, patch.boundary, patch.positions)
    if _signed_areas(start[patch.triangles]).min() <= 0:
        return None
    start *= math.sqrt(_areas(patch.positions[patch.triangles]).sum() / math.pi)
    uv = relax(patch.positions, patch.triangles, patch.boundary, patch.weights, start)
    return uv[patch.triangles[: len(patch.faces)]]


def tutte_embedding(triangles: np.ndarray, boundary: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Tutte's embedding of a disk in the unit circle with equal weights, which is injective (Tutte 1963).

    Args:
        triangles: (face, 3) vertex indices.
        boundary: vertex indices of the outline, counter-clockwise.
        positions: (vertex, 3); the lengths of the outline's edges space its points on the circle.
    """
    count = len(positions)
    lengths = np.linalg.norm(positions[boundary] - positions[np.roll(boundary, -1)], axis=1)
    lengths = np.maximum(lengths, 0.05 * lengths.mean())
    angle = 2 * np.pi * np.concatenate([[0.0], np.cumsum(lengths)[:-1]]) / lengths.sum()
    uv = np.zeros((count, 2))
    uv[boundary] = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner = np.setdiff1d(np.arange(count), boundary)
    if len(inner) == 0:
        return uv
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    ones = np.ones(len(edges))
    adjacency = coo_matrix((ones, (edges[:, 0], edges[:, 1])), shape=(count, count)).tocsr()
    adjacency = ((adjacency + adjacency.T) > 0).astype(float)
    laplacian = (diags(np.asarray(adjacency.sum(axis=1)).ravel()) - adjacency).tocsc()
    known = -laplacian[inner][:, boundary] @ uv[boundary]
    uv[inner] = splu(laplacian[inner][:, inner].tocsc()).solve(np.asarray(known))
    return uv


def _upright(corners: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """The rotation (applied from the right) that turns u towards world +x and v towards -z, by least squares."""
    weights = np.repeat(_areas(corners), 3) / 3 + 1e-30
    world = corners.reshape(-1, 3) - np.average(corners.reshape(-1, 3), axis=0, weights=weights)
    local = flat.reshape(-1, 2) - np.average(flat.reshape(-1, 2), axis=0, weights=weights)
    # On vertical parts height replaces depth, so that v continues from the crown to the nape.
    target = np.stack([world[:, 0], -world[:, 2] - world[:, 1]], axis=1)
    covariance = (local * weights[:, None]).T @ target
    angle = math.atan2(covariance[0, 1] - covariance[1, 0], covariance[0, 0] + covariance[1, 1])
    return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])


def _pack(pieces: list[np.ndarray]) -> list[np.ndarray]:
    """Place pieces in the unit square: shelves of falling height, one common scale."""
    sizes = np.array([piece.reshape(-1, 2).max(axis=0) - piece.reshape(-1, 2).min(axis=0) for piece in pieces])
    order = np.argsort(-sizes[:, 1], kind="stable")
    low, high = sizes.max(), 2.0 * (sizes.sum(axis=0).max() + 1e-12)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _shelves(sizes, order, middle) is not None else (middle, high)
    corners = _shelves(sizes, order, high)
    if corners is None:
        raise ValueError("the pieces of the chart do not fit the square they were measured for")
    inner = 1.0 - MARGIN
    used = np.max(corners + sizes + MARGIN * high, axis=0)
    shift = 0.5 * (high - used) + 0.5 * MARGIN * high
    return [
        MARGIN / 2 + inner * (piece - piece.reshape(-1, 2).min(axis=0) + corner + shift) / high
        for piece, corner in zip(pieces, corners, strict=True)
    ]


def _shelves(sizes: np.ndarray, order: np.ndarray, side: float) -> np.ndarray | None:
    """Lower-left corners of boxes on shelves in a square of this side, or None if they do not fit."""
    gap = MARGIN * side
    corners = np.zeros_like(sizes)
    x = y = shelf = 0.0
    for index in order:
        width, height = sizes[index] + gap
        if x + width > side:
            x, y, shelf = 0.0, y + shelf, 0.0
        if x + width > side or y + height > side:
            return None
        corners[index] = x, y
        x, shelf = x + width, max(shelf, height)
    return corners


def _areas(corners: np.ndarray) -> np.ndarray:
    return 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1)


def _signed_areas(corners: np.ndarray) -> np.ndarray:
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (edge_a[:, 0] * edge_b[:, 1] - edge_a[:, 1] * edge_b[:, 0])
