"""Reads cameras from Agisoft Metashape: the XML of *Export Cameras*."""

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from neural_strands.capture.lens import Lens
from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.preparation.cameras.calibration import PosedLens, rigid_pose

ADVICE = "export the cameras again (File, Export, Export Cameras, Agisoft XML)"
UNSUPPORTED = ("k4", "b2")
"""Coefficients that our lens model lacks (fourth radial, skew); they must be zero."""


def read_metashape(path: Path) -> dict[str, PosedLens]:
    """Read every aligned camera, by label.

    Metashape's camera axes are OpenCV's. Its principal point is relative to the middle of the picture, its p1 and p2
    are OpenCV's p2 and p1, and b1 = fx - fy.

    Raises:
        InputError: the file is not such XML, or a value is missing or wrong.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError, ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: expected Metashape's XML, but it cannot be read as such ({reason(error)}); {ADVICE}."
        ) from error
    lenses = {sensor.get("id"): lens for sensor in root.iter("sensor") if (lens := _lens(path, sensor)) is not None}
    found = {}
    for camera in root.iter("camera"):
        label, transform = camera.get("label", ""), camera.findtext("transform")
        if transform is None or camera.get("enabled", "true") in ("false", "0"):
            continue
        if camera.get("sensor_id") not in lenses:
            raise InputError(f"{path}: {excerpt(label)}: expected a calibrated sensor, found none; {ADVICE}.")
        values = _numbers(path, excerpt(label), transform)
        if len(values) != 16:
            raise InputError(
                f"{path}: {excerpt(label)}: expected a transform of 16 numbers, found {len(values)}; {ADVICE}."
            )
        camera_to_world = np.array(values).reshape(4, 4)
        pose = rigid_pose(camera_to_world, f"{path}: {excerpt(label)}")
        found[label] = PosedLens(lenses[camera.get("sensor_id")], pose)
    if not found:
        raise InputError(f"{path}: expected aligned cameras, found none; align the photographs first, then {ADVICE}.")
    return found


def _lens(path: Path, sensor: ElementTree.Element) -> Lens | None:
    """The lens of a sensor; None if it was not calibrated."""
    calibrations = sensor.findall("calibration")
    if not calibrations:
        return None
    # The adjusted calibration follows the initial one.
    calibration = next((c for c in calibrations if c.get("class") == "adjusted"), calibrations[-1])
    name = f"sensor {excerpt(sensor.get('id'))}"
    kind = calibration.get("type", sensor.get("type", "frame"))
    if kind != "frame":
        raise InputError(
            f"{path}: {name}: expected a frame camera, found {kind[:30]!r}; undistort the photographs first."
        )
    resolution = calibration.find("resolution")
    resolution = sensor.find("resolution") if resolution is None else resolution
    if resolution is None:
        raise InputError(f"{path}: {name}: expected its resolution, found none; {ADVICE}.")

    def number(key: str) -> float:
        text = calibration.findtext(key)
        return 0.0 if text is None else _numbers(path, f"{name}: {key}", text)[0]

    size = _numbers(path, name, f"{resolution.get('width')} {resolution.get('height')}")
    focal = number("f")
    if len(size) != 2 or not all(1 <= side < 10**6 for side in size) or focal <= 0:
        raise InputError(
            f"{path}: {name}: expected a positive size and focal length, found {excerpt(size)} and {focal}; {ADVICE}."
        )
    width, height = int(size[0]), int(size[1])
    if any(number(key) for key in UNSUPPORTED):
        raise InputError(
            f"{path}: {name}: expected a lens without {' and '.join(UNSUPPORTED)}, found them; optimise the cameras "
            "without these, then export again."
        )
    intrinsics = (focal + number("b1"), focal, width / 2 + number("cx"), height / 2 + number("cy"))
    coefficients = (number("k1"), number("k2"), number("p2"), number("p1"), number("k3"))
    try:
        return Lens(intrinsics, coefficients, width, height)
    except ValueError as error:
        raise InputError(f"{path}: {name}: expected {error}; {ADVICE}.") from error


def _numbers(path: Path, place: str, text: str) -> list[float]:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if not values or not all(map(math.isfinite, values)):
        raise InputError(f"{path}: {place}: expected finite numbers, found {text.strip()[:40]!r}; {ADVICE}.")
    return values
