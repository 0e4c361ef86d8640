"""Fits a head to a calibrated face: scale, world frame and the placed head, and their files."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.images import reduced
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.json_files import read_json
from neural_strands.foundation.npz import ArraySpec
from neural_strands.preparation.cameras.calibration import Calibration
from neural_strands.preparation.face.scale import (
    TEMPLATE_SPREAD,
    Scale,
    ScaleCue,
    combine,
    face_cues,
    landmark_distance,
)
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.face.triangulate import TriangulatedFace, triangulate_face
from neural_strands.preparation.head.deform import Evidence, deform
from neural_strands.preparation.head.files import head_arrays, head_of, read_head_arrays
from neural_strands.preparation.head.place import cameras_in_world, place, world_frame
from neural_strands.preparation.head.shoulder_fit import fit_shoulders
from neural_strands.preparation.head.template import Template, near_landmarks, rescaled
from neural_strands.preparation.photographs.folder import read_mask
from neural_strands.preparation.stage import ADVICE
from neural_strands.scalp.fit_similarity import Similarity
from neural_strands.scalp.head import Head

FILE = "head.npz"
FIGURES = "figures.json"
OUTLINE = 50
"""Value of the person mask (of 255) above which a pixel counts as person; low, so that the head does not become too
small."""

ROTATION_TOLERANCE = 1e-6
"""Largest deviation of a stored rotation from an orthonormal one."""
OUTLINE_SIDE = 1024
"""Longer side at which outlines are used, pixels; those of all photographs are kept in memory at once."""


@dataclass(frozen=True)
class KnownSize:
    """Sizes that the user measured.

    Attributes:
        metres_per_unit: metres per unit of the cameras' frame, if known.
        pupil_distance: distance between the pupils, metres, if known.
    """

    metres_per_unit: float | None = None
    pupil_distance: float | None = None


@dataclass(frozen=True)
class FittedHead:
    """A head placed on the person.

    Attributes:
        head: world metres.
        landmarks: landmarks of the template, in world metres; NaN if unknown.
        frame: transform from the cameras' frame to the world.
        figures: measurements for the report.
    """

    head: Head
    landmarks: Float[Tensor, "landmark 3"]
    frame: Similarity
    figures: dict[str, Any]

    def save(self, folder: Path) -> None:
        """Write `head.npz` and `figures.json`."""
        frame = {
            "scale": np.asarray(self.frame.scale),
            "rotation": self.frame.rotation.numpy(),
            "translation": self.frame.translation.numpy(),
        }
        np.savez(folder / FILE, allow_pickle=False, **frame, **head_arrays(self.head, self.landmarks))
        (folder / FIGURES).write_text(json.dumps(self.figures, indent=1), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> "FittedHead":
        """Read what `save` wrote.

        Raises:
            InputError: a file is missing or damaged.
        """
        frame = (ArraySpec("scale", ""), ArraySpec("rotation", "3 3"), ArraySpec("translation", "3"))
        arrays = read_head_arrays(folder / FILE, "a fitted head", frame)
        figures = read_json(folder / FIGURES, "the figures of a fitted head", ADVICE)
        head, landmarks = head_of(arrays)
        rotation, translation = torch.from_numpy(arrays["rotation"]), torch.from_numpy(arrays["translation"])
        skewed = (rotation @ rotation.T - torch.eye(3)).abs().max()
        if not arrays["scale"] > 0 or skewed > ROTATION_TOLERANCE or torch.linalg.det(rotation) < 0:
            raise InputError(
                f"{folder / FILE}: expected a positive scale and a rotation, found something else; {ADVICE}."
            )
        measured = {name: figure.value for name, figure in figures.members().items()}
        return cls(head, landmarks, Similarity(float(arrays["scale"]), rotation, translation), measured)


def fit_head(
    calibration: Calibration,
    faces: Sequence[Sequence[np.ndarray]],
    template: Template,
    known: KnownSize,
    outlines: Sequence[Path | None] | None,
    say: Callable[[str], None],
) -> FittedHead:
    """Place a template on the person by its face, deform it, and define the world's frame and scale by it.

    Args:
        calibration: cameras in any frame and unit.
        faces: detected faces of each view.
        template: a head with landmarks.
        known: sizes that the user measured.
        outlines: a mask of the person for each view, if there is one; None keeps the template's shape.
        say: receives messages for the user.

    Raises:
        InputError: the views do not agree on one face, or too few landmarks are known.
    """
    face = triangulate_face(calibration.cameras, faces)
    agreed = int((face.views >= 0).sum())
    say(f"{agreed} of {len(faces)} photographs agree on the face, to {face.error:.1f} pixels.")
    placement = place(template, face)
    cues = face_cues(face, calibration.cameras, faces)
    cues.append(ScaleCue("template", 1.0 / placement.fit.scale, TEMPLATE_SPREAD))
    scale = combine(cues)
    if known.metres_per_unit is not None:
        scale = Scale(known.metres_per_unit, 0.0)
    elif known.pupil_distance is not None:
        length, error = landmark_distance(face, "right_iris", "left_iris")
        if not length > 0:
            raise InputError("--pupil-distance: expected both irises among the landmarks, found none; use --scale.")
        scale = Scale(known.pupil_distance / length, error)
    say(scale.sentence())
    frame = world_frame(placement, scale.metres_per_unit)
    placed = rescaled(template, scale.metres_per_unit * placement.fit.scale)
    residual = placement.residual * scale.metres_per_unit * placement.fit.scale
    say(f"The head fits {placement.landmarks} landmarks to {1000 * residual:.1f} mm in the median.")
    if outlines is not None:
        evidence = _evidence(calibration, face, frame, placed, outlines)
        placed, change = fit_shoulders(placed, evidence.cameras, evidence.outlines)
        say(change.sentence())
        placed = deform(placed, evidence)
        residual = _residual(placed, frame, face)
        say(f"Deformed to the person: {1000 * residual:.1f} mm from the landmarks in the median.")
    figures = {
        "views_with_face": agreed,
        "landmark_error_px": round(face.error, 3),
        "landmarks_used": placement.landmarks,
        "landmark_residual_mm": round(1000 * residual, 3),
        "metres_per_camera_unit": scale.metres_per_unit,
        "scale_error": round(scale.error, 4),
        "scale_cues": {cue.name: [cue.metres_per_unit, round(cue.error, 4)] for cue in cues},
    }
    return FittedHead(placed.head, placed.landmarks, frame, figures)


def _evidence(
    calibration: Calibration,
    face: TriangulatedFace,
    frame: Similarity,
    placed: Template,
    outlines: Sequence[Path | None],
) -> Evidence:
    """Collect the photographs' evidence on the head's shape, in the world."""
    world = cameras_in_world(calibration.cameras, frame)
    seen = [
        (camera.reduced(OUTLINE_SIDE), reduced(read_mask(path, (camera.width, camera.height)), OUTLINE_SIDE) > OUTLINE)
        for camera, path in zip(world, outlines, strict=True)
        if path is not None
    ]
    return Evidence(
        frame.apply(torch.from_numpy(face.points)).numpy(),
        frame.scale * face.spread,
        frame.apply(torch.from_numpy(calibration.points.position)).numpy(),
        near_landmarks(placed.head.mesh.vertices, placed.landmarks).numpy(),
        [camera for camera, _ in seen],
        [outline for _, outline in seen],
    )


def _residual(placed: Template, frame: Similarity, face: TriangulatedFace) -> float:
    """Median distance of the template's landmarks from the person's, metres."""
    inside = list(INTERIOR)
    gap = placed.landmarks[inside].double() - frame.apply(torch.from_numpy(face.points[inside]))
    return float(gap.norm(dim=1).nanmedian())
