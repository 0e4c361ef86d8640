"""Makes a head for a capture that has none: a template fitted to the faces in its photographs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from jaxtyping import Int64
from PIL import Image
from torch import Tensor

from neural_strands.capture.capture import Capture
from neural_strands.geometry.mesh import Mesh
from neural_strands.preparation.cameras.calibration import Calibration, SparsePoints
from neural_strands.preparation.cameras.stored import TURNS, stored_points
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.face.files import read_marks
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.fit import FittedHead, fit_head
from neural_strands.preparation.head.place import cameras_in_world
from neural_strands.preparation.head.refinement.refine import refine
from neural_strands.preparation.head.request import HeadRequest
from neural_strands.preparation.head.template import Template, find_landmarks, load_template
from neural_strands.preparation.masks.hair import vote_on
from neural_strands.preparation.masks.zones import ZonedHead
from neural_strands.preparation.photographs.folder import read_picture, write_picture
from neural_strands.preparation.photographs.metadata import orientation_of, upright
from neural_strands.preparation.write_capture import person_scalp


@dataclass(frozen=True)
class CaptureHead:
    """A head in the frame of a capture's cameras.

    Attributes:
        mesh: the head in the cameras' frame and unit.
        scalp: the faces that hair grows from.
        figures: measurements for the report.
    """

    mesh: Mesh
    scalp: Int64[Tensor, " scalp"]
    figures: dict[str, Any]


def head_of_capture(capture: Capture, request: HeadRequest, say: Callable[[str], None]) -> CaptureHead:
    """Fit a template to the faces in a capture's photographs.

    Person masks guide its deformation; hair masks delimit the scalp and show the hair to which the skull is raised.
    Where both are known, bare skin moves to the outlines, and neck and shoulders to where the photographs agree.

    Args:
        capture: photographs and cameras.
        request: how to find the head.
        say: receives messages for the user.

    Raises:
        InputError: an input is missing or wrong, or the views do not agree on one face.
    """
    request.check()
    with TemporaryDirectory() as temporary:
        folder = Path(temporary)
        calibration = _calibration(capture, folder)
        if request.landmarks is not None:
            faces = _marked_faces(capture, request.landmarks)
        else:
            faces = _detected_faces(capture, calibration, request.detector, folder)
            say(f"Faces in {sum(bool(found) for found in faces)} of {len(faces)} photographs.")
        outlines = _person_masks(capture, folder) if request.bend else None
        template = _template(request, folder)
        fitted = fit_head(calibration, faces, template, request.size, outlines, say)
    scalp = _scalp(capture, fitted)
    if request.bend and any(file.hair_mask_path is not None for file in capture.files):
        views = replace(capture.views_on(), cameras=cameras_in_world(capture.cameras, fitted.frame))
        fitted = refine(fitted, template, views, say)
    back = fitted.frame.inverse()
    mesh = fitted.head.mesh
    vertices = back.apply(mesh.vertices.double()).to(mesh.vertices)
    return CaptureHead(replace(mesh, vertices=vertices), scalp, fitted.figures)


def _marked_faces(capture: Capture, marks: Path) -> list[list[np.ndarray]]:
    """Faces in the undistorted photographs, from landmarks set by hand on the upright ones."""
    names = [camera.name or f"{index:04d}" for index, camera in enumerate(capture.cameras)]
    files = dict(zip(names, capture.files, strict=True))

    def to_picture(name: str, pixels: np.ndarray) -> np.ndarray:
        lens = files[name].lens
        points = stored_points(pixels, (lens.width, lens.height), orientation_of(files[name].image_path))
        return lens.undistort_points(points)

    return read_marks(marks, names, to_picture)


def _detected_faces(
    capture: Capture, calibration: Calibration, detector: Detector, folder: Path
) -> list[list[np.ndarray]]:
    """Faces in the undistorted photographs; the detector sees them upright, because it finds no faces on their side."""
    orientations = [orientation_of(file.image_path) for file in capture.files]
    pictures = list(calibration.pictures)
    for index, orientation in enumerate(orientations):
        if orientation in TURNS:
            pictures[index] = folder / f"upright_{index:04d}.png"
            stored = Image.fromarray(read_picture(calibration.pictures[index]))
            write_picture(pictures[index], np.asarray(upright(stored, orientation)))
    sizes = [(camera.width, camera.height) for camera in capture.cameras]
    return [
        [stored_points(face, size, orientation) for face in faces]
        for faces, size, orientation in zip(detector.detect(pictures), sizes, orientations, strict=True)
    ]


def _template(request: HeadRequest, folder: Path) -> Template:
    if request.template is None:
        return builtin_template()
    head = load_template(request.template, request.scalp)
    return find_landmarks(head, request.detector, folder, str(request.template))


def _calibration(capture: Capture, folder: Path) -> Calibration:
    """Write the capture's undistorted photographs as files, with their cameras."""
    pictures = []
    for index in range(len(capture)):
        pictures.append(folder / f"{index:04d}.png")
        write_picture(pictures[-1], _bytes(capture.image(index)))
    return Calibration(capture.cameras, tuple(pictures), SparsePoints.none())


def _person_masks(capture: Capture, folder: Path) -> list[Path | None]:
    """Write the capture's person masks as files; None for views without one."""
    files: list[Path | None] = []
    for index in range(len(capture)):
        mask = capture.person_mask(index)
        files.append(None if mask is None else folder / f"person_{index:04d}.png")
        if mask is not None:
            write_picture(folder / f"person_{index:04d}.png", _bytes(mask))
    return files


def _scalp(capture: Capture, fitted: FittedHead) -> Int64[Tensor, " scalp"]:
    """The template's scalp without the parts that the capture's hair masks show to be bare."""
    world = cameras_in_world(capture.cameras, fitted.frame)
    masked = [index for index in range(len(capture)) if capture.hair_mask(index) is not None]
    if not masked:
        return fitted.head.scalp_faces
    zoned = ZonedHead.of(fitted.head, fitted.landmarks)
    masks = (_bytes(mask) for index in masked if (mask := capture.hair_mask(index)) is not None)
    return person_scalp(fitted.head, vote_on([world[index] for index in masked], zoned, masks))


def _bytes(values: Tensor) -> np.ndarray:
    return (values.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
