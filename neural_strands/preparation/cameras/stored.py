"""Cameras of upright photographs, from cameras of the pictures as they are stored.

A phone stores every picture as its sensor sees it, and says in EXIF's orientation how it was held. COLMAP and others
ignore that, so that all pictures share a lens; `prepare` turns the pictures upright, and their cameras must be turned
with them. Some programs, or their users, turn the pictures first: the cameras of those on their side then have the
shape of upright ones.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from neural_strands.preparation.cameras.calibration import PosedLens, find_lens
from neural_strands.preparation.photographs.folder import Photograph
from neural_strands.preparation.photographs.metadata import orientation_of

UPSIDE_DOWN, CLOCKWISE, COUNTER_CLOCKWISE = 3, 6, 8
"""EXIF's orientations of pictures that have to be turned by 180 degrees, or by 90 degrees in a direction."""
ON_SIDE = (CLOCKWISE, COUNTER_CLOCKWISE)
TURNS = {
    UPSIDE_DOWN: np.array([[-1.0, 0.0], [0.0, -1.0]]),
    CLOCKWISE: np.array([[0.0, -1.0], [1.0, 0.0]]),
    COUNTER_CLOCKWISE: np.array([[0.0, 1.0], [-1.0, 0.0]]),
}
"""Rotations of pixels (right, down) that turn the stored picture upright."""


def cameras_of_upright(
    lenses: Mapping[str, PosedLens], photographs: Sequence[Photograph], files: Sequence[Path]
) -> dict[str, PosedLens]:
    """Cameras of photographs as `prepare` turns them, by the names of the photographs' files.

    Args:
        lenses: cameras by image name.
        photographs: the photographs, upright.
        files: the photographs' files.
    """
    found = {photograph: lens for photograph in photographs if (lens := find_lens(photograph, lenses)) is not None}
    held = {shot: orientation for shot, orientation in _orientations(photographs, files).items() if shot in found}
    on_side = [shot for shot, orientation in held.items() if orientation in ON_SIDE]
    if any(_is_upright(shot, found[shot]) for shot in on_side):
        held = {}
    return {shot.source: turned(lens, held.get(shot, 1)) for shot, lens in found.items()}


def as_stored(photographs: Sequence[Photograph], files: Sequence[Path]) -> list[Photograph]:
    """The photographs with the width and height of their files, which may be on their side.

    Args:
        photographs: the photographs, upright.
        files: the photographs' files.
    """
    held = _orientations(photographs, files)
    return [
        replace(shot, width=shot.height, height=shot.width) if held.get(shot) in ON_SIDE else shot
        for shot in photographs
    ]


def turned(posed: PosedLens, orientation: int) -> PosedLens:
    """The camera of a picture that is turned as EXIF's orientation says; mirrored pictures are left as they are."""
    if orientation not in TURNS:
        return posed
    turn, lens = TURNS[orientation], posed.lens
    fx, fy, cx, cy = lens.intrinsics
    k1, k2, p1, p2, k3 = lens.coefficients
    middle = np.array([lens.width, lens.height]) / 2
    size = np.abs(turn) @ (lens.width, lens.height)
    focal = np.abs(turn) @ (fx, fy)
    centre = turn @ (np.array([cx, cy]) - middle) + size / 2
    # Tangential distortion moves pixels along r^2 p + 2 (x . p) x with p = (p2, p1), a vector of the picture.
    across, down = turn @ (p2, p1)
    pose = np.eye(4)
    pose[:2, :2] = turn
    whole = replace(
        lens,
        intrinsics=(float(focal[0]), float(focal[1]), float(centre[0]), float(centre[1])),
        coefficients=(k1, k2, float(down), float(across), k3),
        width=int(size[0]),
        height=int(size[1]),
    )
    return PosedLens(whole, pose @ posed.world_to_camera)


def stored_points(points: np.ndarray, size: tuple[int, int], orientation: int) -> np.ndarray:
    """Where pixels (n, 2) of the upright picture are in the stored one of width and height; mirrored ones stay."""
    turn = TURNS.get(orientation, np.eye(2))
    return (points - np.abs(turn) @ size / 2) @ turn + np.array(size) / 2


def _orientations(photographs: Sequence[Photograph], files: Sequence[Path]) -> dict[Photograph, int]:
    """EXIF's orientation of each photograph that is a file; frames of a video are none."""
    places = {file.name: file for file in files}
    return {shot: orientation_of(places[shot.source]) for shot in photographs if shot.source in places}


def _is_upright(photograph: Photograph, posed: PosedLens) -> bool:
    """Whether a camera has the shape of the upright photograph rather than that of the picture on its side."""
    shape = np.log(posed.lens.width / posed.lens.height)
    upright = np.log(photograph.width / photograph.height)
    return bool(abs(shape - upright) < abs(shape + upright))
