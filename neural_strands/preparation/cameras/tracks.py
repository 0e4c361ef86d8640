"""COLMAP's points on a person, and where the photographs show them."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float64, UInt8

from neural_strands.geometry.cameras import Camera
from neural_strands.preparation.cameras.motion import Tracks

if TYPE_CHECKING:
    import pycolmap

ON_PERSON = 0.8
"""Least share of a point's sightings, in pictures with a mask of the person, that lie on the person."""
SIGHTINGS = 3
"""Fewest photographs that must show a point."""
MOST = 5000
"""Largest number of points; those that most photographs show are taken."""


def person_tracks(
    model: "pycolmap.Reconstruction",
    cameras: Sequence[Camera],
    person: Callable[[int], Bool[np.ndarray, "height width"] | None],
    chosen: Callable[[Float64[np.ndarray, "point 3"]], Bool[np.ndarray, " point"]],
) -> tuple[Tracks, UInt8[np.ndarray, "point 3"]]:
    """Collect the points of a part of the person.

    Args:
        model: COLMAP's.
        cameras: undistorted ones in the model's frame, named like its pictures.
        person: reads whether each pixel of a camera's undistorted picture shows the person; None if that is unknown.
        chosen: tells which places, in the model's frame, may be on that part.

    Returns:
        The points, in a fixed order, and their colours.
    """
    images = {image.name: image for image in model.images.values() if image.has_pose}
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    points = sorted(model.points3D)
    position = np.array([model.points3D[point].xyz for point in points], dtype=np.float64).reshape(-1, 3)
    near = np.flatnonzero(chosen(position)).tolist()
    numbers = {points[index]: number for number, index in enumerate(near)}
    judged, agreeing = np.zeros((2, len(numbers)))
    for number, camera in enumerate(cameras):
        image = images[camera.name]
        marks = [mark for mark in image.points2D if mark.has_point3D() and mark.point3D_id in numbers]
        point = np.array([numbers[mark.point3D_id] for mark in marks], dtype=np.int64)
        seen = np.array([mark.xy for mark in marks], dtype=np.float64).reshape(-1, 2)
        plane = model.cameras[image.camera_id].cam_from_img(seen)
        matrix = camera.intrinsics.double().numpy()
        pixel = np.asarray(plane) * matrix[[0, 1], [0, 1]] + matrix[:2, 2]
        rows.append((np.full(len(point), number), point, pixel))
        shown = person(number)
        if shown is not None:
            column, row = np.floor(pixel).astype(np.int64).T
            inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
            np.add.at(judged, point[inside], 1.0)
            np.add.at(agreeing, point[inside], shown[row[inside], column[inside]].astype(float))
    camera_of, point_of, pixels = (np.concatenate(part) for part in zip(*rows, strict=True))
    count = np.bincount(point_of, minlength=len(numbers))
    usable = (count >= SIGHTINGS) & (agreeing >= ON_PERSON * judged)
    kept = np.sort(np.argsort(-np.where(usable, count, 0), kind="stable")[: min(MOST, int(usable.sum()))])
    renumbered = np.full(len(numbers), -1)
    renumbered[kept] = np.arange(len(kept))
    taken = renumbered[point_of] >= 0
    names = [points[near[number]] for number in kept.tolist()]
    colour = np.array([model.points3D[name].color for name in names], dtype=np.uint8).reshape(-1, 3)
    tracks = Tracks(position[near][kept], camera_of[taken], renumbered[point_of[taken]], pixels[taken])
    return tracks, colour
