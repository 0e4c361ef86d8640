"""Triangulates landmarks from several calibrated photographs, in some of which the detections are wrong.

First a consensus is found: two views propose a face, and the others vote for it. Each landmark is then estimated by
least squares over the views that agreed, reweighted so that views in which it slipped count less.
"""

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.robust import geman_mcclure

PROPOSALS = 600
"""Largest number of pairs of views that propose a face."""
AGREEMENTS = (0.02, 0.04)
"""A view agrees with a proposal up to this median error, as a share of the face's size in the picture. The second is
tried if less than half of the views with a face agree by the first: a few poor detections are better than none."""
WIDEST, NARROWEST = 60.0, 4.0
"""Bounds of the angle between two proposing views, degrees: closer ones hardly determine depth, and more distant ones
seldom show the same points."""
APART = 0.5
"""Faces at least so far from each other, in units of their size, are two people's; nearer ones are one person's, seen
by cameras that disagree."""
ROUNDS = 20
SPREAD = 0.004
"""Scale of the Geman-McClure weights, as a share of the face's size: two pixels for a face 500 pixels wide."""


@dataclass(frozen=True)
class TriangulatedFace:
    """A face in 3D.

    Attributes:
        points: (landmark, 3) in the cameras' frame; NaN if fewer than two views show the landmark.
        spread: (landmark,) robust standard error of each point, in the cameras' unit.
        views: index of each view's face that agreed, -1 if none did.
        error: median reprojection error over all landmarks and views that agreed, pixels.
    """

    points: np.ndarray
    spread: np.ndarray
    views: np.ndarray
    error: float


def triangulate_face(cameras: Sequence[Camera], faces: Sequence[Sequence[np.ndarray]]) -> TriangulatedFace:
    """Find and triangulate the one face that most views agree on.

    Args:
        cameras: cameras of the views.
        faces: detected faces of each view, (landmark, 2) pixels.

    Raises:
        InputError: no two views agree on a face, or they agree on two at different places.
    """
    projections = projection_matrices(cameras)
    detected = sum(bool(found) for found in faces)
    chosen, seen, agreement = np.full(len(cameras), -1), 0, 0.0
    for agreement in AGREEMENTS:
        chosen = _consensus(cameras, projections, faces, agreement)
        seen = int((chosen >= 0).sum())
        if seen >= max(2, detected / 2):
            break
    if seen < 2:
        raise InputError(
            f"{len(cameras)} photographs: expected a face in at least two that agrees with their cameras, found faces "
            f"in {detected}; take photographs from the front, give landmarks (--landmarks) or, if the cameras are in "
            "metres, a head that you have placed in their frame (fit --head)."
        )
    face = _triangulated(projections, faces, chosen)
    others = [[face for k, face in enumerate(found) if k != chosen[view]] for view, found in enumerate(faces)]
    second = _consensus(cameras, projections, others, agreement)
    count = int((second >= 0).sum())
    if count >= max(2, seen // 2) and _apart(face, _triangulated(projections, others, second)) >= APART:
        raise InputError(
            f"{len(cameras)} photographs: expected one person, found two: one in {seen} photographs, another in "
            f"{count}; crop the photographs to one of them, or give the landmarks of one (--landmarks)."
        )
    return face


def triangulate(projections: np.ndarray, pixels: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Least-squares points (point, 3) from their weighted images, by linear equations.

    Args:
        projections: (view, 3, 4) matrices from world to pixels.
        pixels: (view, point, 2); NaN if a view does not show a point.
        weights: (view, point); zero leaves an image out. Dividing by depth makes the residuals pixels.
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
    """Pixels (view, point, 2) and depths (view, point) of points in every view."""
    homogeneous = np.einsum("vij,pj->vpi", projections[..., :3], points) + projections[:, None, :, 3]
    depth = homogeneous[..., 2]
    return homogeneous[..., :2] / np.where(np.abs(depth) < 1e-12, 1e-12, depth)[..., None], depth


def projection_matrices(cameras: Sequence[Camera]) -> np.ndarray:
    """Matrices (view, 3, 4) from world to homogeneous pixels; the last row yields the depth."""
    return np.stack([(camera.intrinsics.double() @ camera.world_to_camera[:3].double()).numpy() for camera in cameras])


def _consensus(
    cameras: Sequence[Camera], projections: np.ndarray, faces: Sequence[Sequence[np.ndarray]], agreement: float
) -> np.ndarray:
    """Index of each view's face that agrees with the best proposal, -1 if none does."""
    candidates = [(view, k) for view, found in enumerate(faces) for k, face in enumerate(found) if _has_size(face)]
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
    # Pairs are taken evenly: this is deterministic and uses all views of a sequence.
    for i, j in (pairs[k] for k in np.unique(np.linspace(0, len(pairs) - 1, min(PROPOSALS, len(pairs))).astype(int))):
        pair = [i, j]
        points = triangulate(projections[views[pair]], pixels[pair], np.ones((2, pixels.shape[1])))
        image, depth = project(projections[views], points)
        with warnings.catch_warnings():
            # Faces that share no landmark with the proposal have no error; they do not agree with it.
            warnings.filterwarnings("ignore", "All-NaN slice", RuntimeWarning)
            error = np.nanmedian(np.linalg.norm(image - pixels, axis=-1), axis=1) / size
            behind = np.nanmedian(depth, axis=1) <= 0
        error[behind | np.isnan(error)] = np.inf
        chosen = np.full(len(cameras), -1)
        score = 0.0
        for candidate in np.argsort(error):
            if error[candidate] > agreement:
                break
            if chosen[views[candidate]] < 0:
                chosen[views[candidate]] = candidates[candidate][1]
                score += 1.0 - error[candidate] / agreement
        # More views score higher; of equally many, those that agree better.
        if (chosen >= 0).sum() >= 2 and score > best_score:
            best, best_score = chosen, score
    return best


def _triangulated(
    projections: np.ndarray, faces: Sequence[Sequence[np.ndarray]], chosen: np.ndarray
) -> TriangulatedFace:
    """The face that the chosen faces of the views show."""
    views = np.flatnonzero(chosen >= 0).tolist()
    pixels = np.stack([faces[view][int(chosen[view])] for view in views])
    return _refined(projections[views], pixels, chosen)


def _apart(first: TriangulatedFace, second: TriangulatedFace) -> float:
    """Distance between the middles of two faces, in units of the first one's size."""
    inside = list(INTERIOR)
    gap = np.nanmedian(second.points[inside], axis=0) - np.nanmedian(first.points[inside], axis=0)
    return float(np.linalg.norm(gap) / _sizes(first.points[None, inside])[0])


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
        # Divide by depth, because the linear equations weight residuals in pixels by it.
        robust = geman_mcclure(np.nan_to_num(squared) / scale**2)
        weights = robust / (scale * np.maximum(np.abs(np.nan_to_num(depth, nan=1.0)), 1e-12)) ** 2
    error = np.sqrt(squared)
    return TriangulatedFace(
        points, _standard_errors(projections, pixels, points, robust), chosen, float(np.nanmedian(error))
    )


def _standard_errors(projections: np.ndarray, pixels: np.ndarray, points: np.ndarray, robust: np.ndarray) -> np.ndarray:
    """Root of the trace of each point's covariance, estimated from the residuals of its views."""
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


def _has_size(face: np.ndarray) -> bool:
    """Whether landmarks of the interior are known at two different places or more."""
    known = face[list(INTERIOR)]
    known = known[np.isfinite(known).all(axis=-1)]
    return len(known) > 1 and bool((known != known[0]).any())


def _sizes(pixels: np.ndarray) -> np.ndarray:
    """Size of each face (face, landmark, 2): the diagonal of its bounding box, pixels."""
    return np.linalg.norm(np.nanmax(pixels, axis=1) - np.nanmin(pixels, axis=1), axis=-1)
