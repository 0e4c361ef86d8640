"""Relaxes a flat disk towards the lengths of its surface, without overlaps.

Minimises the symmetric Dirichlet energy (Smith and Schaefer 2015, "Bijective parameterization with free boundaries") by
L-BFGS preconditioned with the surface's Laplacian. A step that would flip a triangle or make the outline cross itself
is shortened, so the result stays injective.
"""

from collections import deque
from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_matrix, identity
from scipy.sparse.linalg import splu

ITERATIONS = 80
MEMORY = 6
"""Number of past steps that L-BFGS uses."""

TOLERANCE = 1e-4
"""The energy counts as converged if it falls by less than this share over `PATIENCE` steps."""

PATIENCE = 5

Solve = Callable[[np.ndarray], np.ndarray]
"""Solves a linear system for a right-hand side (vertex, 2)."""

Pairs = deque[tuple[np.ndarray, np.ndarray]]
"""Past steps, and the change of the gradient over each."""


def relax(
    positions: np.ndarray, triangles: np.ndarray, boundary: np.ndarray, weights: np.ndarray, start: np.ndarray
) -> np.ndarray:
    """Relax an injective flat map of a disk.

    Args:
        positions: (vertex, 3) metres.
        triangles: (triangle, 3) vertex indices.
        boundary: (rim,) outline, counter-clockwise.
        weights: (triangle,) weight of each triangle's shape.
        start: (vertex, 2) an injective map, metres.

    Returns:
        (vertex, 2) the relaxed map, injective like the start.
    """
    rest_inverse, area = _rest_shapes(positions[triangles])
    area = area * weights
    area = area / area.sum()
    uv, solve = start, _laplacian_solver(triangles, rest_inverse, area, len(positions))
    energy, gradient = _energy(uv, triangles, rest_inverse, area)
    history: Pairs = deque(maxlen=MEMORY)
    energies = [energy]
    for _ in range(ITERATIONS):
        direction = -_two_loop(gradient, history, solve)
        if (direction * gradient).sum() >= 0:
            history.clear()
            direction = -solve(gradient)
        step = _line_search(uv, direction, energy, gradient, (triangles, boundary, rest_inverse, area))
        if step == 0.0:
            if not history:
                break
            history.clear()
            continue
        moved = uv + step * direction
        energy, moved_gradient = _energy(moved, triangles, rest_inverse, area)
        if ((moved_gradient - gradient) * (moved - uv)).sum() > 0:
            history.append((moved - uv, moved_gradient - gradient))
        uv, gradient = moved, moved_gradient
        energies.append(energy)
        if len(energies) > PATIENCE and energies[-1 - PATIENCE] - energy < TOLERANCE * energy:
            break
    return uv


def _rest_shapes(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse (2, 2) edge matrices of each triangle laid flat, and its area; slivers are thickened to be invertible."""
    along = corners[:, 1] - corners[:, 0]
    other = corners[:, 2] - corners[:, 0]
    width = np.linalg.norm(along, axis=1)
    width = np.maximum(width, 0.05 * width.mean() + 1e-12)
    x = (along * other).sum(axis=1) / width
    height = np.linalg.norm(np.cross(along, other), axis=1) / width
    height = np.maximum(height, 0.02 * (width + np.abs(x)))
    inverse = np.zeros((len(corners), 2, 2))
    inverse[:, 0, 0] = 1.0 / width
    inverse[:, 0, 1] = -x / (width * height)
    inverse[:, 1, 1] = 1.0 / height
    return inverse, 0.5 * width * height


def _energy(
    uv: np.ndarray, triangles: np.ndarray, rest_inverse: np.ndarray, area: np.ndarray
) -> tuple[float, np.ndarray]:
    """Symmetric Dirichlet energy sum area (|J|^2 + |J^-1|^2), infinite if a triangle is flipped, and its gradient."""
    corners = uv[triangles]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    jacobian = edges @ rest_inverse
    determinant = np.linalg.det(jacobian)
    if determinant.min() <= 0:
        return np.inf, np.zeros_like(uv)
    square = (jacobian**2).sum(axis=(1, 2))
    cofactor = np.stack(
        [
            np.stack([jacobian[:, 1, 1], -jacobian[:, 1, 0]], axis=1),
            np.stack([-jacobian[:, 0, 1], jacobian[:, 0, 0]], axis=1),
        ],
        axis=1,
    )
    by_jacobian = 2 * jacobian * (1 + determinant**-2)[:, None, None]
    by_jacobian -= (2 * square * determinant**-3)[:, None, None] * cofactor
    by_edges = (area[:, None, None] * by_jacobian) @ rest_inverse.transpose(0, 2, 1)
    by_corner = np.stack([-by_edges.sum(axis=2), by_edges[:, :, 0], by_edges[:, :, 1]], axis=1)
    gradient = np.stack([np.bincount(triangles.ravel(), by_corner[..., k].ravel(), len(uv)) for k in range(2)], axis=1)
    return float((area * square * (1 + determinant**-2)).sum()), gradient


def _laplacian_solver(triangles: np.ndarray, rest_inverse: np.ndarray, area: np.ndarray, count: int) -> Solve:
    """Build a solver for the surface's Laplacian (times the energy's Hessian at rest), slightly regularised."""
    hats = np.stack([-rest_inverse.sum(axis=1), rest_inverse[:, 0], rest_inverse[:, 1]], axis=1)
    blocks = 8 * area[:, None, None] * hats @ hats.transpose(0, 2, 1)
    rows = np.repeat(triangles, 3, axis=1).ravel()
    columns = np.tile(triangles, (1, 3)).ravel()
    laplacian = coo_matrix((blocks.ravel(), (rows, columns)), shape=(count, count)).tocsc()
    factor = splu(laplacian + 1e-6 * laplacian.diagonal().mean() * identity(count, format="csc"))
    return factor.solve


def _two_loop(gradient: np.ndarray, history: Pairs, solve: Solve) -> np.ndarray:
    """L-BFGS's inverse Hessian times the gradient (Nocedal's two loops), preconditioned by `solve`."""
    result, alphas = gradient.copy(), []
    for step, change in reversed(history):
        alpha = (step * result).sum() / (step * change).sum()
        alphas.append(alpha)
        result -= alpha * change
    result = solve(result)
    for (step, change), alpha in zip(history, reversed(alphas), strict=True):
        result += (alpha - (change * result).sum() / (step * change).sum()) * step
    return result


def _line_search(uv: np.ndarray, direction: np.ndarray, energy: float, gradient: np.ndarray, shape: tuple) -> float:
    """The longest step of a halving sequence that lowers the energy enough and keeps the map injective; 0 if none."""
    triangles, boundary, rest_inverse, area = shape
    slope = (direction * gradient).sum()
    step = min(1.0, 0.8 * _first_flip(uv[triangles], direction[triangles]))
    while step > 1e-10:
        moved = uv + step * direction
        lower = _energy(moved, triangles, rest_inverse, area)[0] <= energy + 1e-4 * step * slope
        if lower and is_simple(moved[boundary]):
            return step
        step *= 0.5
    return 0.0


def _first_flip(corners: np.ndarray, moves: np.ndarray) -> float:
    """The smallest positive step at which a triangle's area vanishes (the root of a quadratic per triangle)."""
    edge_a, edge_b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    move_a, move_b = moves[:, 1] - moves[:, 0], moves[:, 2] - moves[:, 0]
    a, c = _cross(move_a, move_b), _cross(edge_a, edge_b)
    b = _cross(edge_a, move_b) + _cross(move_a, edge_b)
    discriminant = b * b - 4 * a * c
    q = -0.5 * (b + np.copysign(np.sqrt(np.maximum(discriminant, 0.0)), b))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.concatenate([q / a, c / q])
    real = np.tile(discriminant >= 0, 2) & np.isfinite(roots) & (roots > 0)
    return float(roots[real].min()) if real.any() else np.inf


def is_simple(loop: np.ndarray) -> bool:
    """Whether a closed polygon (vertex, 2) neither crosses nor touches itself, apart from neighbours' shared ends."""
    start, end = loop, np.roll(loop, -1, axis=0)
    edge = (end - start)[:, None]
    from_start = _cross(edge, start[None] - start[:, None])
    from_end = _cross(edge, end[None] - start[:, None])
    crossing = (from_start * from_end <= 0) & ((from_start * from_end).T <= 0)
    count = len(loop)
    index = np.arange(count)
    gap = (index[None] - index[:, None]) % count
    return not (crossing & (gap > 1) & (gap < count - 1)).any()


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
