"""Naive surface nets: the zero level of a distance function as an even, watertight triangle mesh."""

from collections.abc import Callable, Sequence

import numpy as np

SMOOTHING = 6
"""Rounds of tangential smoothing, each followed by a step back onto the surface."""

PROBE = 1e-4
"""Distance from a point to its probes along each axis, metres."""

TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])

Distance = Callable[[np.ndarray], np.ndarray]
"""Maps points (n, 3) in metres to signed distances (n,), negative inside."""


def surface_nets(distance: Distance, axes: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mesh the zero level of a distance function in a box whose border the surface does not touch.

    Each cell that the surface crosses yields one vertex and each crossed grid edge one quad (Gibson 1998); vertices are
    then spread evenly along the surface and projected onto it.

    Args:
        distance: the solid.
        axes: ascending grid coordinates along x, y and z, metres; may be denser where there is detail.

    Returns:
        vertices (vertex, 3) in metres and faces (face, 3), counter-clockwise seen from outside.
    """
    cells = tuple(len(axis) - 1 for axis in axes)
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = _well_composed((distance(grid.reshape(-1, 3)) < 0).reshape(grid.shape[:3]))
    corners = [inside[i : i + cells[0], j : j + cells[1], k : k + cells[2]] for i, j, k in np.ndindex(2, 2, 2)]
    full = np.sum(corners, axis=0)
    crossed = (full > 0) & (full < 8)
    number = np.full(cells, -1)
    number[crossed] = np.arange(crossed.sum())
    middles = [0.5 * (axis[:-1] + axis[1:]) for axis in axes]
    vertices = np.stack([middle[index] for middle, index in zip(middles, np.nonzero(crossed), strict=True)], axis=1)
    spacing = min(float(np.diff(axis).min()) for axis in axes)
    quads = np.concatenate([_quads(inside, number, axis) for axis in range(3)])
    vertices = _settle(distance, vertices, quads, spacing)
    return vertices, _triangulate(vertices, quads)


def _well_composed(inside: np.ndarray) -> np.ndarray:
    """Fill corners until no two inside corners touch only across a square's or a cube's diagonal.

    Without such contacts the surface between inside and outside is a manifold, and so is its dual mesh.
    """
    inside = inside.copy()
    while True:
        before = inside.sum()
        for axis in range(3):
            plane = np.moveaxis(inside, axis, 0)
            a, b, c, d = plane[:, :-1, :-1], plane[:, 1:, :-1], plane[:, :-1, 1:], plane[:, 1:, 1:]
            crossing = (a == d) & (b == c) & (a != b)
            for corner in (a, b, c, d):
                corner |= crossing
        shape = [size - 1 for size in inside.shape]
        cube = {
            (i, j, k): inside[i : i + shape[0], j : j + shape[1], k : k + shape[2]] for i, j, k in np.ndindex(2, 2, 2)
        }
        total = np.sum(list(cube.values()), axis=0)
        for i, j in np.ndindex(2, 2):
            first, second = cube[0, i, j], cube[1, 1 - i, 1 - j]
            crossing = ((total == 2) & first & second) | ((total == 6) & ~first & ~second)
            for corner in cube.values():
                corner |= crossing
        if inside.sum() == before:
            return inside


def _quads(inside: np.ndarray, number: np.ndarray, axis: int) -> np.ndarray:
    """One quad for each grid edge along `axis` whose ends differ, oriented outwards."""
    along = np.moveaxis(inside, axis, 0)
    # Cyclic order of the other two axes keeps the quads' orientation the same for all three.
    if axis == 1:
        along = np.swapaxes(along, 1, 2)
        number = np.swapaxes(np.moveaxis(number, 1, 0), 1, 2)
    else:
        number = np.moveaxis(number, axis, 0)
    change = along[:-1, 1:-1, 1:-1] != along[1:, 1:-1, 1:-1]
    i, j, k = np.nonzero(change)
    quad = np.stack([number[i, j, k], number[i, j + 1, k], number[i, j + 1, k + 1], number[i, j, k + 1]], axis=1)
    outwards = along[:-1, 1:-1, 1:-1][i, j, k]
    return np.where(outwards[:, None], quad, quad[:, ::-1])


def _settle(distance: Distance, vertices: np.ndarray, quads: np.ndarray, spacing: float) -> np.ndarray:
    """Alternate averaging over neighbours and steps onto the surface."""
    ends = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    degree = np.bincount(ends[:, 0], minlength=len(vertices))
    for _ in range(SMOOTHING):
        mean = np.stack(
            [np.bincount(ends[:, 0], vertices[ends[:, 1], k], len(vertices)) / degree for k in range(3)], axis=1
        )
        vertices = _onto(distance, 0.5 * (vertices + mean), spacing)
    return _onto(distance, _onto(distance, vertices, spacing), spacing)


def _onto(distance: Distance, points: np.ndarray, limit: float) -> np.ndarray:
    """One Newton step towards the zero level, no longer than `limit`."""
    # Four probes at the corners of a tetrahedron give value and gradient at once.
    probed = np.stack([distance(points + PROBE * corner) for corner in TETRAHEDRON], axis=1)
    value, gradient = probed.mean(axis=1), probed @ TETRAHEDRON / (4 * PROBE)
    square = np.maximum((gradient**2).sum(axis=1), 0.05)
    step = -value / square
    length = np.abs(step) * np.sqrt(square)
    return points + (step * np.minimum(1.0, limit / np.maximum(length, 1e-12)))[:, None] * gradient


def _triangulate(vertices: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Cut each quad along its shorter diagonal."""
    corners = vertices[quads]
    first = np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1)
    second = np.linalg.norm(corners[:, 1] - corners[:, 3], axis=1)
    # The tolerance makes mirror images be cut in the same way.
    turned = np.where((first <= second + 1e-9)[:, None], quads, np.roll(quads, -1, axis=1))
    return np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
