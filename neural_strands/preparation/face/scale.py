"""The scale of the cameras in metres, from what is known about human faces.

No single length suffices: people's eyes, faces and skulls vary by several per cent. A cue compares a length of the face
in the cameras' unit with its mean over adults; its error combines their relative spread with that of the measurement.
Cues are averaged in the logarithm; those that disagree with the rest count less.

Means and spreads over adult women and men together, after L. G. Farkas, *Anthropometry of the Head and Face* (1994),
and the U.S. Army's anthropometric survey of 2012 (ANSUR II); the iris after corneal topography (white to white).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.face.topology import LEFT_IRIS, NAMED, RIGHT_IRIS
from neural_strands.preparation.face.triangulate import TriangulatedFace, project, projection_matrices

LENGTHS = (
    ("pupil distance", "right_iris", "left_iris", 0.0630, 0.058),
    ("outer eye corners", "right_eye_outer", "left_eye_outer", 0.0895, 0.045),
    ("inner eye corners", "right_eye_inner", "left_eye_inner", 0.0325, 0.085),
    ("face width", "right_cheek", "left_cheek", 0.1370, 0.050),
    ("mouth width", "mouth_right", "mouth_left", 0.0525, 0.075),
    ("nose bridge to chin", "nose_bridge", "chin", 0.1175, 0.065),
)
"""Name, two landmarks, mean distance in metres, relative spread over people."""
IRIS, IRIS_SPREAD = 0.0117, 0.040
"""Horizontal diameter of the visible iris, metres, and its relative spread."""
IRIS_ERROR = 0.03
"""Relative error of the detected width of an iris, which is some ten pixels wide."""
TEMPLATE_SPREAD = 0.05
"""Relative spread of the size of people's faces around the template's."""
COMMON_SPREAD = 0.025
"""Part of the spread that all lengths of one head share, because a large head is large in all of them."""
FRONTAL = 35.0
"""Largest angle from the front at which the width of irises is measured, degrees."""
REWEIGHTINGS = 50


@dataclass(frozen=True)
class ScaleCue:
    """One length from which the scale follows.

    Attributes:
        name: what was measured.
        metres_per_unit: the scale that it implies.
        error: relative standard error, from the spread over people and the measurement.
    """

    name: str
    metres_per_unit: float
    error: float


@dataclass(frozen=True)
class Scale:
    """The scale of a calibration.

    Attributes:
        metres_per_unit: metres per unit of the cameras' frame.
        error: relative standard error.
        cues: the cues that were combined; empty if the scale was given.
    """

    metres_per_unit: float
    error: float
    cues: tuple[ScaleCue, ...] = ()

    def sentence(self) -> str:
        """A sentence for the user about the scale and its cues."""
        if not self.cues:
            error = f", ± {100 * self.error:.1f} %" if self.error else ""
            return f"Scale as given: {1000 * self.metres_per_unit:.2f} mm per unit of the cameras{error}."
        cues = ", ".join(f"{cue.name} {1000 * cue.metres_per_unit:.1f} ± {100 * cue.error:.0f} %" for cue in self.cues)
        return (
            f"Scale: {1000 * self.metres_per_unit:.1f} mm per unit of the cameras, ± {100 * self.error:.1f} % "
            f"({cues}); --pupil-distance with a measured length removes most of this error."
        )


def face_cues(
    face: TriangulatedFace, cameras: Sequence[Camera], faces: Sequence[Sequence[np.ndarray]]
) -> list[ScaleCue]:
    """Measure every length of the face that the landmarks allow.

    Args:
        face: the face in the cameras' frame and unit.
        cameras: cameras of the views.
        faces: detected faces of each view.
    """
    cues = []
    for name, first, second, metres, spread in LENGTHS:
        length, error = landmark_distance(face, first, second)
        if length > 0:
            cues.append(ScaleCue(name, metres / length, math.hypot(spread, error)))
    iris = iris_diameter(face, cameras, faces)
    if iris > 0:
        cues.append(ScaleCue("iris", IRIS / iris, math.hypot(IRIS_SPREAD, IRIS_ERROR)))
    return cues


def combine(cues: Sequence[ScaleCue]) -> Scale:
    """Combine cues: a weighted mean of logarithms, with Cauchy weights against outliers.

    Raises:
        ValueError: there are no cues.
    """
    if not cues:
        raise ValueError("a scale needs at least one cue")
    value = np.log([cue.metres_per_unit for cue in cues])
    variance = np.array([cue.error for cue in cues]) ** 2
    mean = float(np.median(value))
    weight = 1.0 / variance
    for _ in range(REWEIGHTINGS):
        weight = 1.0 / (variance + (value - mean) ** 2)
        mean = float(weight @ value / weight.sum())
    spread = math.sqrt(float((weight**2 * np.maximum(variance, (value - mean) ** 2)).sum())) / float(weight.sum())
    return Scale(math.exp(mean), math.hypot(spread, COMMON_SPREAD), tuple(cues))


def landmark_distance(face: TriangulatedFace, first: str, second: str) -> tuple[float, float]:
    """Distance between two named landmarks in the cameras' unit, and its relative error; zeros if either is unknown."""
    a, b = NAMED[first], NAMED[second]
    length = float(np.linalg.norm(face.points[a] - face.points[b]))
    if not length > 0:
        return 0.0, 0.0
    return length, float(math.hypot(face.spread[a], face.spread[b])) / length


def iris_diameter(face: TriangulatedFace, cameras: Sequence[Camera], faces: Sequence[Sequence[np.ndarray]]) -> float:
    """Median width of the irises over the frontal views, in the cameras' unit; 0 if no view shows them.

    Measured view by view, because eyes that follow the camera have no fixed place in space.
    """
    front = face_normal(face)
    widths = []
    for view in np.flatnonzero(face.views >= 0).tolist():
        camera, pixels = cameras[view], faces[view][face.views[view]]
        toward = -camera.rotation[2].double().numpy()
        if not toward @ front > math.cos(math.radians(FRONTAL)):
            continue
        focal = 0.5 * float(camera.intrinsics[0, 0] + camera.intrinsics[1, 1])
        for border, centre in ((RIGHT_IRIS, "right_eye"), (LEFT_IRIS, "left_eye")):
            corners = face.points[[NAMED[f"{centre}_outer"], NAMED[f"{centre}_inner"]]].mean(axis=0)
            _, depth = project(projection_matrices([camera]), corners[None])
            # Take the larger of two diameters: lids cover the vertical one, and turning the eye narrows the other.
            across = max(float(np.linalg.norm(pixels[border[k]] - pixels[border[k + 2]])) for k in range(2))
            widths.append(across * float(depth[0, 0]) / focal)
    known = [width for width in widths if width > 0]
    return float(np.median(known)) if known else 0.0


def face_normal(face: TriangulatedFace) -> np.ndarray:
    """Unit direction out of the face, from the eyes' outer corners and the chin."""
    right, left, chin = (face.points[NAMED[name]] for name in ("right_eye_outer", "left_eye_outer", "chin"))
    normal = np.cross(chin - right, left - right)
    return normal / np.linalg.norm(normal)
