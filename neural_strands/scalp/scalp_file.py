"""Where hair grows, as a file says it: a chart, a list of faces or vertices, or a painted mask."""

import gzip
import json
import math
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.scalp.mesh_file import MeshFile

PAINTED = 0.5
"""Brightness from which a mask's pixel is scalp."""
SHOWN = 60
"""Characters of a wrong value that an error repeats."""


@dataclass(frozen=True)
class ScalpFile:
    """What a file says about the scalp of a mesh.

    Attributes:
        path: the file.
        faces: triangles of the mesh that hair may grow from, in rising order.
        uv: chart coordinates of their corners, where the file holds a chart.
    """

    path: Path
    faces: Int64[Tensor, " scalp"]
    uv: Float[Tensor, "scalp 3 2"] | None = None

    def where(self, kept: Tensor) -> "ScalpFile":
        """Only some of the faces, by a mask."""
        return ScalpFile(self.path, self.faces[kept], None if self.uv is None else self.uv[kept])


def read_scalp_file(path: Path, source: MeshFile) -> ScalpFile:
    """Read which faces of a mesh hair grows from; faces are polygons, counted from 0 in file order.

    Args:
        path: a chart `.json` or `.json.gz` (face number -> loop number -> uv, MakeHuman's format); a `.json` list of
            face numbers (or {"faces": [...]}, {"vertices": [...]}); or an image painted bright over the scalp in the
            mesh's own uv.
        source: the mesh that it belongs to.

    Raises:
        InputError: the file is missing, unreadable or contradicts the mesh.
    """
    if not path.is_file():
        raise InputError(f"{path}: expected a scalp (chart, list or mask), found no file; check the path.")
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected a scalp, but it cannot be read ({error.strerror or error}).") from error
    if not path.name.endswith((".json", ".json.gz")):
        return ScalpFile(path, _painted(path, raw, source))
    try:
        content = json.loads(gzip.decompress(raw) if path.suffix == ".gz" else raw)
    except (OSError, EOFError, ValueError, zlib.error, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, found something else ({type(error).__name__}).") from error
    if isinstance(content, list):
        content = {"faces": content}
    if isinstance(content, dict) and isinstance(content.get("faces"), list):
        return ScalpFile(path, _of_polygons(source, _indices(content["faces"], source.polygons, "face", path)))
    if isinstance(content, dict) and isinstance(content.get("vertices"), list):
        count = len(source.mesh.vertices)
        chosen = torch.zeros(count, dtype=torch.bool)
        chosen[_indices(content["vertices"], count, "vertex", path)] = True
        return ScalpFile(path, torch.nonzero(chosen[source.mesh.faces].all(dim=1)).squeeze(1))
    return _charted(path, content, source)


def _charted(path: Path, content: Any, source: MeshFile) -> ScalpFile:
    """Read face number -> loop number -> uv."""
    try:
        numbers = [int(face) for face in content]
        loops = {int(loop): (float(u), float(v)) for corners in content.values() for loop, (u, v) in corners.items()}
    except (TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(
            f"{path}: expected face number -> loop number -> [u, v], or a list of faces, found something else; "
            "export the chart again."
        ) from error
    faces = _of_polygons(source, _indices(numbers, source.polygons, "face", path))
    wanted = source.loops[faces.numpy()]
    missing = sorted(set(wanted.ravel().tolist()) - loops.keys())
    if missing:
        raise InputError(f"{path}: expected uv for every loop of its faces, found none for loop {missing[0]}.")
    uv = [[loops[loop] for loop in face] for face in wanted.tolist()]
    if not all(math.isfinite(value) for face in uv for corner in face for value in corner):
        raise InputError(f"{path}: expected finite uv, found NaN or infinity; export the chart again.")
    return ScalpFile(path, faces, torch.tensor(uv, dtype=torch.float32).reshape(-1, 3, 2))


def _of_polygons(source: MeshFile, numbers: Int64[Tensor, " polygon"]) -> Int64[Tensor, " scalp"]:
    """The triangles of the named polygons."""
    return torch.from_numpy(np.flatnonzero(np.isin(source.polygon, numbers.numpy())))


def _indices(values: list[Any], count: int, kind: str, path: Path) -> Int64[Tensor, " index"]:
    wrong = [value for value in values if not (type(value) is int and 0 <= value < count)]
    if wrong:
        found = repr(wrong[0])[:SHOWN]
        raise InputError(f"{path}: expected {kind} numbers from 0 to {count - 1}, found {found}; is it another mesh's?")
    return torch.tensor(sorted(set(values)), dtype=torch.int64)


def _painted(path: Path, raw: bytes, source: MeshFile) -> Int64[Tensor, " scalp"]:
    """Faces whose middle is painted bright in the mesh's own uv (the tile [0, 1] of UDIM layouts)."""
    import cv2

    if source.mesh.corner_uv is None:
        raise InputError(f"{path}: expected a mesh with texture coordinates to apply this mask, found none.")
    try:
        image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_GRAYSCALE) if raw else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{path}: expected a JSON file or an image, found neither.")
    centre = source.mesh.corner_uv.mean(dim=1)
    height, width = image.shape
    column = (centre[:, 0] * width).floor().long()
    row = ((1.0 - centre[:, 1]) * height).floor().long()
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    bright = torch.from_numpy(image).float()[row.clamp(0, height - 1), column.clamp(0, width - 1)] >= PAINTED * 255
    return torch.nonzero(inside & bright).squeeze(1)
