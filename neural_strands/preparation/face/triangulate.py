"""Landmarks in 3D from their images in several calibrated photographs, where some detections are wrong.

First a consensus: two views propose a face, the others vote for it. Then each landmark is found by least squares over
the views that agreed, reweighted so that views in which it slipped count less.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.face.topology import INTERIOR

PROPOSALS = 600
"""Pairs of views that may propose a face."""
AGREEMENT = 0.02
"""Median error, in the face's own size in the picture, up to which a view agrees with a proposal."""
WIDEST, NARROWEST = 60.0, 4.0
"""Degrees between two views that propose: nearer ones give no depth, and farther ones seldom show the same points."""
ROUNDS = 20
SPREAD = 0.004
"""Robust scale of the reweighting (Geman-McClure), in the face's size: about two pixels of a face 500 pixels wide."""


@dataclass(frozen=True)
class TriangulatedFace:
    """A face in 3D.

    Attributes:
        points: (landmark, 3) in the cameras' frame; NaN where fewer than two views show it.
        spread: (landmark,) robust standard error of each point, in the cameras' unit.
        views: for each view the number of its face that agreed, -1 for none.
        error: median reprojection error over all landmarks and views that agreed, pixels.
    """

    points: np.ndarray
    spread: np.ndarray
    views: np.ndarray
    error: float


def triangulate_face(cameras: Sequence[Camera], faces: Sequence[Sequence[np.ndarray]]) -> TriangulatedFace:
    """Find the one face that most views agree on.

    Args:
        cameras: of the views.
        faces: for each view its detected faces, (landmark, 2) pixels.

    Raises:
        InputError: no two views agree on a face, or they agree on more than one.
    """
    projections = projection_matrices(cameras)
    chosen = _consensus(cameras, projections, faces)
    seen = int((chosen >= 0).sum())
    detected = sum(bool(found) for found in faces)
    if seen < 2:
        raise InputError(
            f"{len(cameras)} photographs: expected a face in at least two that agrees with their cameras, found faces "
            f"in {detected}; take photographs from the front, or give landmarks (--landmarks)."
        )
    others = [[face for k, face in enumerate(found) if k != chosen[view]] for view, found in enumerate(faces)]
    second = int((_consensus(cameras, projections, others) >= 0).sum())
    if second >= max(2, seen // 2):
        raise InputError(
            f"{len(cameras)} photographs: expected one person, found two: one in {seen} photographs, another in "
            f"{second}; crop the photographs to one of them."
        )
    views = np.flatnonzero(chosen >= 0).tolist()
    pixels = np.stack([faces[view][int(chosen[view])] for view in views])
    return _refined(projections[views], pixels, chosen)


def triangulate(projections: np.ndarray, pixels: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Least-squares points (point, 3) from weighted images: linear, with rows scaled to pixels by the caller's weights.

    Args:
        projections: (view, 3, 4).
        pixels: (view, point, 2); NaN where a view does not show a point.
        weights: (view, point), zero to leave out.
    """
    known = np.isfinite(pixels).all(axis=-1) & (weights > 0)
    uv = np.nan_to_num(pixels)
    rows = uv[..., None] * projections[:, None, None, 2] - projections[:, None, :2]
    rows = rows * (np.sqrt(weights) * known)[..., None, None]
    a, b = rows[..., :3], -rows[..., 3]
    system = np.einsum("vpki,vpkj->pij", a, a)
    right = np.einsum("vpki,vpk->pi", a, b)
    enough = known.sum(axis=0) >= 2
    system[~enough] = np.eye(3)
    points = np.linalg.solve(system, right[..., None])[..., 0]
    points[~enough] = np.nan
    return points


def project(projections: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Images (view, point, 2) and depths (view, point) of points in every view."""
    homogeneous = np.einsum("vij,pj->vpi", projections[..., :3], points) + projections[:, None, :, 3]
    depth = homogeneous[..., 2]
    return homogeneous[..., :2] / np.where(np.abs(depth) < 1e-12, 1e-12, depth)[..., None], depth


def projection_matrices(cameras: Sequence[Camera]) -> np.ndarray:
    """(view, 3, 4) from world to pixels; the last row gives depth."""
    return np.stack([(camera.intrinsics.double() @ camera.world_to_camera[:3].double()).numpy() for camera in cameras])


def _consensus(cameras: Sequence[Camera], projections: np.ndarray, faces: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    """For each view the face that agrees with the proposal most views agree with, -1 for none."""
    candidates = [(view, k) for view, found in enumerate(faces) for k in range(len(found))]
    best = np.full(len(cameras), -1)
    if len(candidates) < 2:
        return best
    pixels = np.stack([faces[view][k][list(INTERIOR)] for view, k in candidates])
    views = np.array([view for view, _ in candidates])
    size = _sizes(pixels)
    axes = np.stack([camera.rotation[2].double().numpy() for camera in cameras])[views]
    angle = np.degrees(np.arccos(np.clip(axes @ axes.T, -1.0, 1.0)))
    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(candidates)), 2)
        if views[i] != views[j] and NARROWEST <= angle[i, j] <= WIDEST
    ]
    best_score = 0.0
    # Taken evenly from all pairs: deterministic, and the views of a sequence are all drawn.
    for i, j in (pairs[k] for k in np.unique(np.linspace(0, len(pairs) - 1, min(PROPOSALS, len(pairs))).astype(int))):
        pair = [i, j]
        points = triangulate(projections[views[pair]], pixels[pair], np.ones((2, pixels.shape[1])))
        image, depth = project(projections[views], points)
        error = np.nanmedian(np.linalg.norm(image - pixels, axis=-1), axis=1) / size
        error[(np.nanmedian(depth, axis=1) <= 0) | np.isnan(error)] = np.inf
        chosen = np.full(len(cameras), -1)
        score = 0.0
        for candidate in np.argsort(error):
            if error[candidate] > AGREEMENT:
                break
            if chosen[views[candidate]] < 0:
                chosen[views[candidate]] = candidates[candidate][1]
                score += 1.0 - error[candidate] / AGREEMENT
        # More views win; among as many, those that agree better.
        if (chosen >= 0).sum() >= 2 and score > best_score:
            best, best_score = chosen, score
    return best


def _refined(projections: np.ndarray, pixels: np.ndarray, chosen: np.ndarray) -> TriangulatedFace:
    """Reweighted least squares over the views that agreed."""
    size = _sizes(pixels[:, list(INTERIOR)])
    scale = (SPREAD * size)[:, None]
    weights = np.repeat(1.0 / scale**2, pixels.shape[1], axis=1)
    points, squared, robust = np.zeros(0), np.zeros(0), np.zeros(0)
    for _ in range(ROUNDS):
        points = triangulate(projections, pixels, weights)
        image, depth = project(projections, points)
        squared = ((image - pixels) ** 2).sum(axis=-1)
        # The linear equations count a pixel in proportion to its depth.
        robust = (1.0 + np.nan_to_num(squared) / scale**2) ** -2
        weights = robust / (scale * np.maximum(np.abs(np.nan_to_num(depth, nan=1.0)), 1e-12)) ** 2
    error = np.sqrt(squared)
    return TriangulatedFace(
        points, _standard_errors(projections, pixels, points, robust), chosen, float(np.nanmedian(error))
    )


def _standard_errors(projections: np.ndarray, pixels: np.ndarray, points: np.ndarray, robust: np.ndarray) -> np.ndarray:
    """Root of the trace of each point's covariance, from the residuals that its views leave."""
    image, depth = project(projections, points)
    rows = (projections[:, None, :2, :3] - image[..., None] * projections[:, None, None, 2, :3]) / depth[
        ..., None, None
    ]
    rows = np.nan_to_num(rows) * np.sqrt(robust)[..., None, None]
    residual = np.nan_to_num(((image - pixels) ** 2).sum(axis=-1)) * robust
    known = np.isfinite(pixels).all(axis=-1).sum(axis=0)
    variance = residual.sum(axis=0) / np.maximum(2 * robust.sum(axis=0) - 3, 1.0)
    system = np.einsum("vpki,vpkj->pij", rows, rows)
    usable = (known >= 2) & np.isfinite(points).all(axis=-1)
    system[~usable] = np.eye(3)
    covariance = np.linalg.inv(system) * variance[:, None, None]
    return np.where(usable, np.sqrt(np.trace(covariance, axis1=1, axis2=2)), np.nan)


def _sizes(pixels: np.ndarray) -> np.ndarray:
    """How large each face (face, landmark, 2) is in its picture: the diagonal of its bounding box, pixels."""
    return np.linalg.norm(np.nanmax(pixels, axis=1) - np.nanmin(pixels, axis=1), axis=-1)
