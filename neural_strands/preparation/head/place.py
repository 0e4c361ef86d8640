"""Places a template head on a person: the similarity that maps its landmarks to those of the photographs.

Only landmarks that stay in place on the skin are used; the border of the face slips towards the silhouette, and lips
open.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera, TorsoMotion
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.face.triangulate import TriangulatedFace
from neural_strands.preparation.head.template import Template
from neural_strands.preparation.robust import geman_mcclure
from neural_strands.scalp.fit_similarity import Similarity, umeyama

FEWEST = 8
"""Fewest landmarks that both must have."""
LIKENESS = 0.003
"""Expected difference between a person's face and the template's, metres."""
ROUNDS = 30


@dataclass(frozen=True)
class Placement:
    """Pose and scale of a template.

    Attributes:
        fit: transform from the template's metres to the cameras' frame.
        residual: median distance of the used landmarks, metres of the template.
        landmarks: number of landmarks used.
    """

    fit: Similarity
    residual: float
    landmarks: int


def place(template: Template, face: TriangulatedFace) -> Placement:
    """Fit the similarity by least squares, reweighted so that landmarks in which the two differ count less.

    Raises:
        InputError: too few landmarks are known on both.
    """
    inside = np.array(INTERIOR)
    source = template.landmarks.double().numpy()[inside]
    target = face.points[inside]
    known = np.isfinite(source).all(axis=1) & np.isfinite(target).all(axis=1)
    if known.sum() < FEWEST:
        raise InputError(
            f"Placing the head: expected at least {FEWEST} landmarks known on both template and person, found "
            f"{known.sum()}; give more landmarks, or a template with a plainer face."
        )
    source, target = source[known], target[known]
    spread = np.nan_to_num(template.spread.double().numpy()[inside][known])
    error = np.nan_to_num(face.spread[inside][known])
    fit = umeyama(source, target, np.ones(len(source)))
    gap = _gap(fit, source, target)
    for _ in range(ROUNDS):
        variance = LIKENESS**2 + spread**2 + (error / fit.scale) ** 2
        fit = umeyama(source, target, geman_mcclure(gap**2 / variance) / variance)
        gap = _gap(fit, source, target)
    return Placement(fit, float(np.median(gap)), len(source))


def _gap(fit: Similarity, source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Distances of the targets from their sources, in the sources' unit."""
    return np.linalg.norm(fit.inverse().apply(torch.from_numpy(target)).numpy() - source, axis=1)


def world_frame(placement: Placement, metres_per_unit: float) -> Similarity:
    """The transform from the cameras' frame to the world: the template's axes and origin, metres."""
    back = placement.fit.inverse()
    factor = metres_per_unit / back.scale
    return Similarity(metres_per_unit, back.rotation, factor * back.translation)


def cameras_in_world(cameras: Sequence[Camera], frame: Similarity) -> tuple[Camera, ...]:
    """Express cameras in a world that is transformed by `frame`."""
    return tuple(
        replace(
            camera,
            world_to_camera=_moved(camera.world_to_camera, frame),
            world_to_room=None if camera.world_to_room is None else _in_world(camera.world_to_room, frame),
            torso=None if camera.torso is None else _torso_in_world(camera.torso, frame),
        )
        for camera in cameras
    )


def _moved(pose: Float[Tensor, "4 4"], frame: Similarity) -> Float[Tensor, "4 4"]:
    """A transform from the cameras' frame, in the world's metres and from the world instead."""
    moved = torch.eye(4, dtype=torch.float64)
    moved[:3, :3] = pose[:3, :3].double() @ frame.rotation.double().T
    moved[:3, 3] = frame.scale * pose[:3, 3].double() - moved[:3, :3] @ frame.translation.double()
    return moved.float()


def _in_world(motion: Float[Tensor, "4 4"], frame: Similarity) -> Float[Tensor, "4 4"]:
    """A motion within the cameras' frame as one within the world."""
    turned, rotation = _moved(motion, frame).double(), frame.rotation.double()
    moved = torch.eye(4, dtype=torch.float64)
    moved[:3, :3] = rotation @ turned[:3, :3]
    moved[:3, 3] = rotation @ turned[:3, 3] + frame.translation.double()
    return moved.float()


def _torso_in_world(torso: TorsoMotion, frame: Similarity) -> TorsoMotion:
    return TorsoMotion(_in_world(torso.motion, frame), frame.apply(torso.neck.double()).float())
