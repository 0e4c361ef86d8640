"""Fits a template head to given roots: scale, rotation and translation, by iterative closest points (ICP).

Grooms often come without their head, in any unit and with any axis up. Matches in both directions are used together
(roots to scalp and scalp to roots); with only one the scale diverges.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import KDTree
from torch import Tensor

from neural_strands.geometry.mesh_queries import MeshIndex
from neural_strands.scalp.head import Head
from neural_strands.scalp.roots import sample_roots

COARSE_POINTS = 300
FINE_POINTS = 2000
COARSE_ROUNDS = 12
FINE_ROUNDS = 60
POLISH_ROUNDS = 250
FINALISTS = 3
"""Number of the 24 axis-aligned starts that are refined."""

ROOT_TRIM = 0.1
"""Share of the roots farthest from the scalp that is ignored as outliers."""

SCALP_TRIM = 0.35
"""Share of the scalp farthest from any root that is ignored; grooms need not cover all of it."""

SCALP_WEIGHT = 0.5
"""Weight of the scalp's matches relative to those of the roots."""

BELIEF = 1.3
"""The fit with the usual axes (y up, +z front) is preferred unless its score exceeds a rotated one's by this factor."""

SETTLED = 1e-6
"""Relative change of the residual at which the fit stops."""


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation @ x + translation.

    Attributes:
        scale: positive factor.
        rotation: proper rotation.
        translation: translation, in the target's unit.
        residual: root mean square of the distances from roots to scalp and from scalp to roots, target's unit; 0 if not
            fitted.
    """

    scale: float
    rotation: Float[Tensor, "3 3"]
    translation: Float[Tensor, "3"]
    residual: float = 0.0

    def apply(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Transform points."""
        return self.scale * points @ self.rotation.T.to(points) + self.translation.to(points)

    def inverse(self) -> "Similarity":
        """The inverse transform."""
        back = -(self.rotation.T @ self.translation) / self.scale
        return Similarity(1.0 / self.scale, self.rotation.T, back, self.residual / self.scale)


def fit_similarity(head: Head, root_positions: Float[Tensor, "root 3"], any_axes: bool = True) -> Similarity:
    """Find the similarity that maps the head's scalp to given roots.

    Args:
        head: the template.
        root_positions: roots all over a scalp, in any unit; at least ten.
        any_axes: try all 24 axis-aligned rotations; otherwise the roots are assumed to be y up, +z out of the face.

    Raises:
        ValueError: fewer than ten roots.
    """
    if len(root_positions) < 10:
        raise ValueError(f"a similarity fit needs at least ten roots, found {len(root_positions)}")
    roots = root_positions.detach().cpu().double().numpy()
    # A separate generator with a fixed seed, so that the same input gives the same fit.
    scalp = sample_roots(head.to("cpu"), FINE_POINTS, torch.Generator().manual_seed(0)).position.double().numpy()
    index = MeshIndex(head.to("cpu").scalp_mesh)
    turns = _axis_rotations() if any_axes else [np.eye(3)]
    coarse = (scalp[:COARSE_POINTS], _spread(roots, COARSE_POINTS))
    # Fit only scale and position first: with a free rotation, a wrong start would end in a wrong minimum.
    trials = [_iterate(_start(turn, scalp, roots), index, *coarse, COARSE_ROUNDS, turning=False) for turn in turns]
    upright = next(trial for trial, turn in zip(trials, turns, strict=True) if np.allclose(turn, np.eye(3)))
    best = [upright, *sorted((trial for trial in trials if trial is not upright), key=_score)[:FINALISTS]]
    fine = (scalp, _spread(roots, FINE_POINTS))
    upright, *others = (_iterate(trial, index, *fine, FINE_ROUNDS, turning=True) for trial in best)
    winner = min(others, key=_score, default=upright)
    chosen = upright if _score(upright) <= BELIEF * _score(winner) else winner
    return _iterate(chosen, index, *fine, POLISH_ROUNDS, turning=True)


def _score(fit: Similarity) -> float:
    """Residual relative to the head's scale, so that a larger head does not win."""
    return fit.residual / fit.scale


def umeyama(
    source: Float[np.ndarray, "point 3"],
    target: Float[np.ndarray, "point 3"],
    weights: Float[np.ndarray, " point"],
    turn: Float[np.ndarray, "3 3"] | None = None,
) -> Similarity:
    """Least-squares similarity between matched points (Umeyama 1991), its scale the ratio of the spreads (Horn 1987).

    That ratio is symmetric in source and target, whereas a least-squares scale shrinks under noise. A given rotation
    `turn` is kept fixed.
    """
    weights = weights / weights.sum()
    source_mean, target_mean = weights @ source, weights @ target
    x, y = source - source_mean, target - target_mean
    if turn is None:
        u, _, vt = np.linalg.svd((y * weights[:, None]).T @ x)
        turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    scale = float(np.sqrt((weights @ (y**2).sum(axis=1)) / (weights @ (x**2).sum(axis=1))))
    translation = target_mean - scale * turn @ source_mean
    return Similarity(scale, torch.from_numpy(turn), torch.from_numpy(translation))


def _iterate(
    start: Similarity, index: MeshIndex, scalp: np.ndarray, roots: np.ndarray, rounds: int, turning: bool
) -> Similarity:
    """Alternate matching and solving; the residual is over all matches in both directions, trimmed ones included."""
    tree, fit, previous = KDTree(roots), start, np.inf
    turn = None if turning else start.rotation.numpy()
    for _ in range(rounds):
        on_scalp = index.closest(fit.inverse().apply(torch.from_numpy(roots)).float())
        root_gap = on_scalp.distance.double().numpy() * fit.scale
        gap, match = tree.query(fit.apply(torch.from_numpy(scalp)).numpy())
        residual = float(np.sqrt(0.5 * ((gap**2).mean() + (root_gap**2).mean())))
        fit = replace(fit, residual=residual)
        if abs(previous - residual) < SETTLED * residual:
            break
        previous = residual
        kept, root_kept = _kept(gap, SCALP_TRIM), _kept(root_gap, ROOT_TRIM)
        source = np.concatenate([scalp[kept], on_scalp.position.double().numpy()[root_kept]])
        target = np.concatenate([roots[np.asarray(match)[kept]], roots[root_kept]])
        shares = (np.full(kept.sum(), SCALP_WEIGHT / kept.sum()), np.full(root_kept.sum(), 1.0 / root_kept.sum()))
        solved = umeyama(source, target, np.concatenate(shares), turn)
        fit = replace(solved, residual=residual)
    return fit


def _kept(gap: np.ndarray, trim: float) -> np.ndarray:
    return gap <= np.quantile(gap, 1.0 - trim)


def _start(turn: np.ndarray, scalp: np.ndarray, roots: np.ndarray) -> Similarity:
    """The similarity with a given rotation that equalises centres and spreads."""
    scale = float(np.sqrt(roots.var(axis=0).sum() / scalp.var(axis=0).sum()))
    translation = roots.mean(axis=0) - scale * turn @ scalp.mean(axis=0)
    return Similarity(scale, torch.from_numpy(turn), torch.from_numpy(translation))


def _axis_rotations() -> list[np.ndarray]:
    """The 24 rotations that permute the axes."""
    rotations = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                rotations.append(matrix)
    return rotations


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    """At most `count` points, taken evenly from the list."""
    return points[np.linspace(0, len(points) - 1, min(count, len(points))).round().astype(int)]
