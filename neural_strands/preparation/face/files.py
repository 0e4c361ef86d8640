"""Files of detected faces, and of landmarks set by hand."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from neural_strands.foundation.errors import InputError, excerpt
from neural_strands.foundation.json_files import JsonValue, read_json
from neural_strands.preparation.face.topology import LANDMARKS, NAMED
from neural_strands.preparation.photographs.names import stem_of
from neural_strands.preparation.stage import ADVICE

FACES = "faces.json"


def write_faces(folder: Path, names: Sequence[str], faces: Sequence[Sequence[np.ndarray]]) -> None:
    """Write the faces of each picture."""
    document = {name: [_rows(face) for face in found] for name, found in zip(names, faces, strict=True)}
    (folder / FACES).write_text(json.dumps(document, allow_nan=False), encoding="utf-8")


def _rows(face: np.ndarray) -> list[list[float | None]]:
    """Pixels of a face's landmarks; null where they are unknown, because JSON has no NaN."""
    return [[None if math.isnan(value) else value for value in mark] for mark in np.round(face, 3).tolist()]


def read_faces(folder: Path, names: Sequence[str]) -> list[list[np.ndarray]]:
    """Read what `write_faces` wrote, in the order of `names`.

    Raises:
        InputError: the file is missing or damaged.
    """
    written = read_json(folder / FACES, "faces", ADVICE).members()
    return [[_landmarks(face) for face in written[name].elements()] if name in written else [] for name in names]


def _landmarks(face: JsonValue) -> np.ndarray:
    """Pixels (landmark, 2) of a face; NaN where a mark is null."""
    marks = face.elements()
    if len(marks) != LANDMARKS:
        raise face.refuse(f"{LANDMARKS} landmarks")
    found = np.full((LANDMARKS, 2), np.nan)
    for place, mark in enumerate(marks):
        if mark.value != [None, None]:
            found[place] = mark.array(2)
    return found


def read_marks(
    path: Path, names: Sequence[str], to_picture: Callable[[str, np.ndarray], np.ndarray]
) -> list[list[np.ndarray]]:
    """Read landmarks set by hand: JSON, {photograph: {landmark: [x, y]}}, pixels of the photograph as it was taken.

    A landmark is one of the names of `topology.NAMED`, or its number.

    Args:
        path: the file.
        names: names of the pictures; the file may omit their folders and suffixes.
        to_picture: takes a picture's name and pixels (n, 2) of its photograph to pixels of the picture, which may have
            another size and no distortion.

    Returns:
        For each picture, a list of one face or of none, in pixels of the picture.

    Raises:
        InputError: the file is malformed, names an unknown landmark, marks none of the pictures, or does not say which.
    """
    marked = parse_marks(path)
    marks_of: dict[str, str] = {}
    for mark in marked:
        meant = [mark] if mark in names else [name for name in names if _is_same(mark, name)]
        if len(meant) > 1:
            raise InputError(
                f"{path}: expected the name of one photograph, found {excerpt(mark)}, which {meant[0]} and {meant[1]} "
                "share; write the folder too."
            )
        if meant and (other := marks_of.setdefault(meant[0], mark)) != mark:
            raise InputError(
                f"{path}: expected the landmarks of {meant[0]} once, found {excerpt(other)} and {excerpt(mark)}; "
                "remove one."
            )
    if not marks_of:
        raise InputError(
            f"{path}: expected landmarks on photographs that have a camera (such as {names[0]}), found them on "
            f"{len(marked)} others; use the photographs' names, or set landmarks on those."
        )
    return [[_moved(marked[marks_of[name]], name, to_picture)] if name in marks_of else [] for name in names]


def parse_marks(path: Path) -> dict[str, np.ndarray]:
    """Read such a file: the landmarks (landmark, 2) of each photograph, by its name in the file.

    Photographs without any landmark are left out.

    Raises:
        InputError: the file is malformed, or names an unknown landmark.
    """
    document = read_json(path, "landmarks, {photograph: {landmark: [x, y]}}")
    return {name: _face(marks) for name, marks in document.members().items() if marks.members()}


def _is_same(mark: str, name: str) -> bool:
    """Whether a name in a file of landmarks is that of a picture; either may lack folders and suffix."""
    folders = {str(PurePosixPath(path).parent) for path in (mark, name)} - {"."}
    return stem_of(mark) == stem_of(name) and len(folders) < 2


def _moved(face: np.ndarray, name: str, to_picture: Callable[[str, np.ndarray], np.ndarray]) -> np.ndarray:
    """The landmarks that are known, in pixels of the picture."""
    known = np.isfinite(face).all(axis=1)
    moved = np.full_like(face, np.nan)
    moved[known] = to_picture(name, face[known])
    return moved


def _face(marks: JsonValue) -> np.ndarray:
    face = np.full((LANDMARKS, 2), np.nan)
    for landmark, place in marks.members().items():
        number = NAMED.get(landmark, int(landmark) if landmark.isdecimal() and len(landmark) < 4 else LANDMARKS)
        if number >= LANDMARKS:
            raise InputError(
                f"{marks.source}: {marks.place}: expected landmarks out of {', '.join(NAMED)}, found "
                f"{excerpt(landmark)}; rename it."
            )
        face[number] = place.array(2)
    return face
