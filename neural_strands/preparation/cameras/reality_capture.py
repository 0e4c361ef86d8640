"""Reads cameras from RealityCapture (RealityScan): the CSV of *Internal/External camera parameters*."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from neural_strands.capture.lens import Lens
from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.preparation.cameras.calibration import PosedLens, rigid_pose
from neural_strands.preparation.photographs.names import stem_of

FILM_WIDTH = 36.0
"""Longer side of 35 mm film, millimetres, to which focal length and principal point refer."""
COLUMNS = ("#name", "x", "y", "alt", "heading", "pitch", "roll", "f", "px", "py", "k1", "k2", "k3", "k4", "t1", "t2")
ADVICE = "export it again (Alignment, Export, Registration, Internal/External camera parameters)"


def read_reality_capture(path: Path, sizes: Mapping[str, tuple[int, int]]) -> dict[str, PosedLens]:
    """Read the cameras of photographs of known size; the file itself does not contain sizes.

    Args:
        path: the CSV.
        sizes: width and height of the photographs, by name.

    Raises:
        InputError: the file is not such a CSV, or a value is wrong.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as lines:
            reader = csv.DictReader(lines)
            missing = [column for column in COLUMNS if column not in (reader.fieldnames or ())]
            if missing:
                raise InputError(f"{path}: expected the columns {', '.join(COLUMNS)}, found no {missing[0]}; {ADVICE}.")
            rows = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"{path}: expected RealityCapture's CSV, but it cannot be read as such ({reason(error)}); {ADVICE}."
        ) from error
    stems = {stem_of(name): size for name, size in sizes.items()}
    found = {}
    for row in rows:
        # A row that is too short lacks its last columns.
        name = row["#name"] or ""
        size = stems.get(stem_of(name))
        if size is not None:
            found[name] = _camera(path, row, size)
    return found


def _camera(path: Path, row: dict[str, str], size: tuple[int, int]) -> PosedLens:
    source = f"{path}: {excerpt(row['#name'])}"
    try:
        value = {column: float(row[column]) for column in COLUMNS[1:]}
    except (ValueError, TypeError):
        value = {}
    if not value or not all(map(math.isfinite, value.values())) or value["f"] <= 0:
        raise InputError(f"{source}: expected finite numbers and a positive focal length, found others; {ADVICE}.")
    if value["k4"]:
        raise InputError(f"{source}: expected a lens without k4, found {value['k4']:g}; align again with Brown3.")
    width, height = size
    pixels = max(size) / FILM_WIDTH
    focal = value["f"] * pixels
    centre = (width / 2 + value["px"] * pixels, height / 2 + value["py"] * pixels)
    coefficients = (value["k1"], value["k2"], value["t1"], value["t2"], value["k3"])
    try:
        lens = Lens((focal, focal, *centre), coefficients, width, height)
    except ValueError as error:
        raise InputError(f"{source}: expected {error}; {ADVICE}.") from error
    camera_to_world = np.eye(4)
    # Heading runs clockwise from north (y) seen from above (z); the camera's own axes are OpenGL's.
    turn = _turn(2, -value["heading"]) @ _turn(0, value["pitch"]) @ _turn(1, value["roll"])
    camera_to_world[:3, :3] = turn @ np.diag([1.0, -1.0, -1.0])
    camera_to_world[:3, 3] = value["x"], value["y"], value["alt"]
    return PosedLens(lens, rigid_pose(camera_to_world, source))


def _turn(axis: int, degrees: float) -> np.ndarray:
    """Right-handed rotation about a coordinate axis."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix
