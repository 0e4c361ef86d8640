"""The built-in template: the mannequin as a mean adult, and the landmarks that a face detector found.

The mannequin's skull is 206 mm long and 151 mm broad, and its forehead recedes by 19 degrees. The published means of
adult men are 197 and 154 mm; for the forehead, 10 degrees are an estimate. Hair grows there, and no photograph shows
the skull under it, so the template needs the mean shape. The mannequin's neck and shoulders are those of a wig stand;
the template's are a mean adult's (`shoulders.py`), because long hair lies in front of them and behind them.

The mannequin's face is too plain for a detector, so eyes, brows, nostrils and lips are painted on it first. The
landmarks are shipped with the package; `detect_builtin` detects them again after the mannequin's shape has changed.
"""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.shoulders import MEAN, with_shoulders
from neural_strands.preparation.head.template import SKIN, Template, bust, find_landmarks
from neural_strands.scalp.mannequin import mannequin

BROW, LIP, WHITE, IRIS, PUPIL, LINE = (
    (0.07, 0.04, 0.03),
    (0.55, 0.20, 0.18),
    (0.85, 0.85, 0.85),
    (0.12, 0.07, 0.04),
    (0.01, 0.01, 0.01),
    (0.10, 0.04, 0.03),
)
"""Colours of the paint, linear RGB."""
EYE = (0.0312, 0.0000)
"""Middle of the left eye, x and y, metres, in the mannequin's frame."""
EYE_SIZE = (0.0148, 0.0054)
"""Half width and half height of the opening of the lids, metres."""
IRIS_RADIUS, PUPIL_RADIUS = 0.0058, 0.0024
BROW_PATH = ((0.0130, 0.0175), (0.0300, 0.0235), (0.0465, 0.0190))
BROW_WIDTH = 0.0030
MOUTH_HEIGHT, MOUTH_HALF = -0.0658, 0.0235
UPPER_LIP, LOWER_LIP = 0.0075, 0.0095
NOSTRIL, NOSTRIL_SIZE = (0.0075, -0.0375), (0.0042, 0.0022)
FRONT = 0.04
"""Least z of painted points, metres in front of the ears."""
BACK = 0.87
"""Factor on the depth of everything behind the ears."""
DEEPER, BROWS, HAIRLINE = 0.125, 0.03, 0.08
"""Share by which the depth of the forehead grows, from none at the height of the brows to all at that of the hairline,
metres in the template's frame."""

STORED = Path(__file__).with_name("landmarks.npz")
"""File with the mannequin's landmarks and their spread over views, metres."""


def builtin_template() -> Template:
    """The mannequin with a mean adult's skull, neck and shoulders, and its landmarks."""
    with np.load(STORED, allow_pickle=False) as stored:
        landmarks, spread = with_mean_skull(torch.from_numpy(stored["landmarks"])), torch.from_numpy(stored["spread"])
    head = bust(mannequin())
    vertices = with_shoulders(with_mean_skull(head.mesh.vertices), landmarks[NAMED["chin"]], MEAN)
    return Template(replace(head, mesh=replace(head.mesh, vertices=vertices)), landmarks, spread)


def with_mean_skull(points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
    """Move points of the mannequin's bust so that skull and forehead have the proportions of a mean adult."""
    y, z = points[:, 1], points[:, 2]
    grown = 1.0 + DEEPER * smoothstep((y - BROWS) / (HAIRLINE - BROWS))
    return torch.stack([points[:, 0], y, torch.where(z < 0, BACK * z, grown * z)], dim=1)


def detect_builtin(detector: Detector, folder: Path) -> Template:
    """Detect the landmarks of the mannequin, with its own skull, anew; renderings are left in `folder`.

    Raises:
        InputError: the detector failed, or found no face.
    """
    return find_landmarks(bust(mannequin()), detector, folder, "the mannequin", face_paint)


def store_builtin(template: Template, path: Path = STORED) -> None:
    """Write the landmarks that `builtin_template` reads."""
    np.savez_compressed(path, landmarks=template.landmarks.numpy(), spread=template.spread.numpy())


def face_paint(points: Float[Tensor, "point 3"]) -> Float[Tensor, "point 3"]:
    """Colours of the mannequin's skin, eyes, brows, nostrils and lips."""
    x, y, z = points[:, 0].abs(), points[:, 1], points[:, 2]
    colour = torch.tensor(SKIN).expand(len(points), 3).clone()

    def lay(where: Tensor, paint: tuple[float, float, float]) -> None:
        colour[where & (z > FRONT)] = torch.tensor(paint)

    across, up = (x - EYE[0]) / EYE_SIZE[0], (y - EYE[1]) / EYE_SIZE[1]
    lid = (1.0 - across.square()).clamp(min=0.0)
    opened = (across.abs() < 1.0) & (up.abs() < lid)
    from_iris = torch.hypot(x - EYE[0], y - EYE[1])
    lay((across.abs() < 1.12) & (up < 1.25 * lid + 0.22) & (up > 0.7 * lid - 0.1), LINE)
    lay(opened, WHITE)
    lay(opened & (from_iris < IRIS_RADIUS), IRIS)
    lay(opened & (from_iris < PUPIL_RADIUS), PUPIL)
    lay(_near_path(x, y, BROW_PATH) < BROW_WIDTH, BROW)
    lay(((x - NOSTRIL[0]) / NOSTRIL_SIZE[0]).square() + ((y - NOSTRIL[1]) / NOSTRIL_SIZE[1]).square() < 1.0, LINE)
    mouth = (1.0 - (x / MOUTH_HALF).square()).clamp(min=0.0)
    lay((x < MOUTH_HALF) & (y < MOUTH_HEIGHT + UPPER_LIP * mouth) & (y > MOUTH_HEIGHT - LOWER_LIP * mouth), LIP)
    lay((x < MOUTH_HALF) & ((y - MOUTH_HEIGHT).abs() < 0.0009), LINE)
    return colour


def _near_path(x: Tensor, y: Tensor, path: tuple[tuple[float, float], ...]) -> Tensor:
    """Distance to a chain of segments in the plane."""
    gaps = []
    for (x0, y0), (x1, y1) in itertools.pairwise(path):
        along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
        along = along.clamp(0.0, 1.0)
        gaps.append(torch.hypot(x - x0 - along * (x1 - x0), y - y0 - along * (y1 - y0)))
    return torch.stack(gaps).amin(dim=0)
