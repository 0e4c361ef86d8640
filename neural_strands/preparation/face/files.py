"""Detected faces on disk, and landmarks that a person set by hand."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.face.topology import LANDMARKS, NAMED

FACES = "faces.json"


def write_faces(folder: Path, names: Sequence[str], faces: Sequence[Sequence[np.ndarray]]) -> None:
    """Write the faces of each picture."""
    document = {name: [np.round(face, 3).tolist() for face in found] for name, found in zip(names, faces, strict=True)}
    # JSON has no NaN, though Python writes it: null stands for it.
    text = json.dumps(document).replace("NaN", "null")
    (folder / FACES).write_text(text, encoding="utf-8")


def read_faces(folder: Path, names: Sequence[str]) -> list[list[np.ndarray]]:
    """Read what `write_faces` wrote, in the order of `names`."""
    document = json.loads((folder / FACES).read_text(encoding="utf-8"))
    return [[np.array(face, dtype=np.float64) for face in document.get(name, [])] for name in names]


def read_marks(path: Path, names: Sequence[str]) -> list[list[np.ndarray]]:
    """Read landmarks set by hand: JSON, {photograph: {landmark: [x, y]}}, pixels of the photograph.

    A landmark is one of the names of `topology.NAMED`, or its number.

    Args:
        path: the file.
        names: pictures; one is found by its name or its stem.

    Returns:
        For each picture one face, or none.

    Raises:
        InputError: the file is wrong, names an unknown landmark, or marks none of the pictures.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: expected JSON with landmarks, {{photograph: {{landmark: [x, y]}}}}, but it cannot be read "
            f"({str(error)[:100]})."
        ) from error
    if not isinstance(document, dict) or not all(isinstance(marks, dict) for marks in document.values()):
        raise InputError(f"{path}: expected {{photograph: {{landmark: [x, y]}}}}, found something else; write it so.")
    marked = {Path(name).stem.lower(): _face(path, name, marks) for name, marks in document.items()}
    found = [[marked[stem]] if (stem := Path(name).stem.lower()) in marked else [] for name in names]
    if not any(found):
        raise InputError(
            f"{path}: expected landmarks on the photographs (such as {names[0]}), found them on {len(marked)} others; "
            "use the photographs' names."
        )
    return found


def _face(path: Path, name: str, marks: dict) -> np.ndarray:
    face = np.full((LANDMARKS, 2), np.nan)
    for landmark, place in marks.items():
        number = NAMED.get(landmark, int(landmark) if landmark.isdecimal() and len(landmark) < 4 else LANDMARKS)
        if number >= LANDMARKS:
            raise InputError(
                f"{path}: {name[:60]}: expected landmarks out of {', '.join(NAMED)}, found {landmark[:40]!r}; "
                "rename it."
            )
        pair = (
            isinstance(place, list) and len(place) == 2 and all(type(x) in (int, float) and abs(x) < 1e6 for x in place)
        )
        if not pair:
            raise InputError(f"{path}: {name[:60]}: {landmark}: expected [x, y] in pixels, found {str(place)[:40]!r}.")
        face[number] = place
    return face
