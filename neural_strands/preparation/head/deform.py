"""Deforms a placed template to fit the person: landmarks, skin points, and the outline in every view.

The displacement of the vertices should be smooth (a small Laplacian), small, and match the data. This is a sparse
linear least-squares problem, solved repeatedly as matches and weights change. Where nothing is visible, as under the
hair, the displacement fades out over some centimetres.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import torch
from scipy import sparse

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, face_normals
from neural_strands.geometry.mesh_queries import ClosestPoints, MeshIndex
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.interpolation import attached, interpolation
from neural_strands.preparation.head.laplacian import factorised, laplacian
from neural_strands.preparation.head.template import Template
from neural_strands.preparation.robust import geman_mcclure

BEND = 2.5e-4
"""Expected size of the displacement's Laplacian (mean of the neighbours less the vertex), metres."""
MOVE = 0.010
"""Expected size of the displacement itself, metres."""
LANDMARK = 0.0015
"""Error of every landmark's position on the skin, metres, in addition to its own."""
SKIN, SKIN_REACH = 0.002, 0.012
"""Error of a point on the skin, and its largest distance from the template, metres."""
OUTSIDE, SLACK = 0.002, 0.002
"""Error of an outline, and distance by which a vertex may lie outside it, metres."""
ROUNDS = 6


@dataclass(frozen=True)
class Evidence:
    """Observations of a person's head, in world metres.

    Attributes:
        landmarks: (landmark, 3); NaN if unknown.
        landmark_error: (landmark,) standard errors.
        points: (point, 3) in the scene; those near the face are assumed to be skin.
        on_face: (vertex,) the template's vertices that skin points may lie on.
        cameras: cameras of the views with an outline.
        outlines: for each of these, whether each pixel (height, width) shows the person.
    """

    landmarks: np.ndarray
    landmark_error: np.ndarray
    points: np.ndarray
    on_face: np.ndarray
    cameras: Sequence[Camera]
    outlines: Sequence[np.ndarray]


def deform(template: Template, evidence: Evidence) -> Template:
    """Deform a placed template (world metres) to match the evidence."""
    rest = template.head.mesh
    count = len(rest.vertices)
    inside = np.array(INTERIOR)
    source = template.landmarks.double().numpy()[inside]
    target = evidence.landmarks[inside]
    known = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    anchors = attached(rest, torch.from_numpy(source[known]).float())
    spread = np.nan_to_num(template.spread.double().numpy()[inside][known])
    variance = LANDMARK**2 + spread**2 + np.nan_to_num(evidence.landmark_error[inside][known]) ** 2
    smooth = laplacian(rest)
    fixed = (smooth.T @ smooth) / BEND**2 + sparse.identity(count) / MOVE**2
    start = rest.vertices.double().numpy()
    moved = np.zeros_like(start)
    weight = 1.0 / variance
    for _ in range(ROUNDS):
        current = Mesh(torch.from_numpy(start + moved).float(), rest.faces)
        outside, goal = _outline_rows(current, evidence, start)
        system = sparse.csc_matrix(fixed + anchors.T @ sparse.diags(weight) @ anchors + outside.T @ outside)
        right = anchors.T @ (weight[:, None] * (target[known] - anchors @ start)) + outside.T @ goal
        moved = _solve(system, right, *_skin_rows(current, evidence, start))
        gap = np.linalg.norm(anchors @ (start + moved) - target[known], axis=1)
        # Landmarks that no smooth deformation reaches have slipped.
        weight = geman_mcclure(gap**2 / (9.0 * variance)) / variance
    mesh = replace(rest, vertices=torch.from_numpy(start + moved).float())
    landmarks = template.landmarks.clone()
    every = torch.isfinite(landmarks).all(dim=1)
    carried = attached(rest, landmarks[every]) @ (start + moved)
    landmarks[every] = torch.from_numpy(carried).to(landmarks)
    return replace(template, head=replace(template.head, mesh=mesh), landmarks=landmarks)


def _solve(system: sparse.csc_matrix, right: np.ndarray, skin: sparse.csr_matrix, gap: np.ndarray) -> np.ndarray:
    """The displacement (vertex, 3) that solves the equations of each axis, and those of the skin for all axes together.

    Args:
        system: normal equations of one axis.
        right: their right-hand sides (vertex, 3).
        skin: equations of x, then y, then z of all vertices.
        gap: their values.
    """
    if len(gap) == 0:
        return factorised(system).solve(right)
    together = sparse.csc_matrix(sparse.block_diag([system] * 3) + skin.T @ skin)
    return factorised(together).solve(right.T.ravel() + skin.T @ gap).reshape(3, -1).T


def _skin_rows(current: Mesh, evidence: Evidence, start: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Equations that pull the face along its normal to the skin points near it."""
    count = len(start)
    faces = current.faces[torch.from_numpy(evidence.on_face)[current.faces].all(dim=1)]
    if len(evidence.points) == 0 or len(faces) == 0:
        return sparse.csr_matrix((0, 3 * count)), np.zeros(0)
    face = Mesh(current.vertices, faces)
    closest = MeshIndex(face).closest(torch.from_numpy(evidence.points).float())
    near = closest.distance.numpy() < SKIN_REACH
    inner = (closest.barycentric > 0.01).all(dim=1).numpy()
    kept = torch.from_numpy(near & inner)
    closest = ClosestPoints(
        closest.face[kept], closest.barycentric[kept], closest.position[kept], closest.distance[kept]
    )
    normal = face_normals(face)[closest.face].double().numpy()
    gap = closest.distance.double().numpy()
    weight = 1.0 / (1.0 + (gap / (3 * SKIN)) ** 2) / SKIN
    at = interpolation(face, closest.face, closest.barycentric)
    rows = sparse.csr_matrix(sparse.hstack([sparse.diags(weight * normal[:, axis]) @ at for axis in range(3)]))
    values = weight * (normal * (evidence.points[kept.numpy()] - at @ start)).sum(axis=1)
    return rows, values


def _outline_rows(current: Mesh, evidence: Evidence, start: np.ndarray) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Equations of each axis that pull vertices outside an outline onto it, in the view where they are worst."""
    count = len(start)
    worst = np.zeros(count)
    goal = start.copy()
    for camera, outline in zip(evidence.cameras, evidence.outlines, strict=True):
        pixels, depth = camera.project(current.vertices)
        column, row = pixels.nan_to_num(-1.0).floor().long().unbind(dim=1)
        # Beyond the border of the picture nothing is known.
        within = (column >= 1) & (row >= 1) & (column < camera.width - 1) & (row < camera.height - 1) & (depth > 0)
        away, labels = cv2.distanceTransformWithLabels(
            (~outline).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        labels = labels.astype(np.int64)
        nearest = np.zeros((labels.max() + 1, 2))
        rows_in, columns_in = np.nonzero(outline)
        nearest[labels[rows_in, columns_in]] = np.stack([columns_in + 0.5, rows_in + 0.5], axis=1)
        r, c = row.clamp(0, camera.height - 1).numpy(), column.clamp(0, camera.width - 1).numpy()
        metres = away[r, c] * depth.numpy() / float(camera.intrinsics[0, 0]) - SLACK
        worse = within.numpy() & (metres > worst)
        if not worse.any():
            continue
        onto = torch.from_numpy(nearest[labels[r, c]][worse]).float()
        goal[worse] = camera.unproject(onto, depth[torch.from_numpy(worse)]).double().numpy()
        worst[worse] = metres[worse]
    asked = np.flatnonzero(worst > 0)
    pick = sparse.csr_matrix((np.full(len(asked), 1.0 / OUTSIDE), (np.arange(len(asked)), asked)), (len(asked), count))
    return pick, (goal - start)[asked] / OUTSIDE
