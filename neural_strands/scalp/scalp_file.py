"""Reads where hair grows from a file: a chart, a list of faces or vertices, or a painted mask."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.image_files import image_size
from neural_strands.foundation.input_files import read_bytes
from neural_strands.foundation.json_files import JsonValue, read_json
from neural_strands.scalp.mesh_file import MeshFile

MOST_LOOPS = 10**9
"""Largest number of corners of a mesh, over all polygons."""
PAINTED = 0.5
"""Brightness above which a pixel of a mask is scalp."""


@dataclass(frozen=True)
class ScalpFile:
    """The scalp of a mesh, as read from a file.

    Attributes:
        path: the file.
        faces: triangles of the mesh that hair may grow from, ascending.
        uv: chart coordinates of their corners, if the file contains a chart.
    """

    path: Path
    faces: Int64[Tensor, " scalp"]
    uv: Float[Tensor, "scalp 3 2"] | None = None

    def where(self, kept: Tensor) -> "ScalpFile":
        """Keep the faces selected by a mask."""
        return ScalpFile(self.path, self.faces[kept], None if self.uv is None else self.uv[kept])


def read_scalp_file(path: Path, source: MeshFile) -> ScalpFile:
    """Read which faces of a mesh hair grows from; faces are polygons, counted from 0 in file order.

    Args:
        path: a chart `.json` or `.json.gz` (face number -> loop number -> uv, MakeHuman's format); a `.json` list of
            face numbers (or {"faces": [...]}, {"vertices": [...]}); or an image painted bright over the scalp in the
            mesh's own uv.
        source: the mesh that the file belongs to.

    Raises:
        InputError: the file is missing, unreadable or contradicts the mesh.
    """
    what = "what says where hair grows (a chart, a list of faces or a mask)"
    if not path.name.endswith((".json", ".json.gz")):
        return ScalpFile(path, _painted(path, read_bytes(path, what), source))
    document = read_json(path, what, "give the list or chart that was made for this mesh")
    if isinstance(document.value, list):
        return ScalpFile(path, _of_polygons(source, document.wholes(0, source.polygons - 1)))
    if not isinstance(document.value, dict):
        raise document.refuse("a list of faces, or face number -> loop number -> [u, v]")
    if (listed := document.optional("faces")) is not None:
        return ScalpFile(path, _of_polygons(source, listed.wholes(0, source.polygons - 1)))
    if (listed := document.optional("vertices")) is not None:
        chosen = torch.zeros(len(source.mesh.vertices), dtype=torch.bool)
        chosen[listed.wholes(0, len(chosen) - 1)] = True
        return ScalpFile(path, torch.nonzero(chosen[source.mesh.faces].all(dim=1)).squeeze(1))
    return _charted(path, document, source)


def _charted(path: Path, document: JsonValue, source: MeshFile) -> ScalpFile:
    """Read face number -> loop number -> uv."""
    charted = document.members()
    numbers = [_number(name, source.polygons, document) for name in charted]
    loops: dict[int, np.ndarray] = {}
    for corners in charted.values():
        loops |= {_number(name, MOST_LOOPS, corners): uv.array(2) for name, uv in corners.members().items()}
    faces = _of_polygons(source, numbers)
    wanted = source.loops[faces.numpy()]
    missing = sorted(set(wanted.ravel().tolist()) - loops.keys())
    if missing:
        raise InputError(f"{path}: expected uv for every loop of its faces, found none for loop {missing[0]}.")
    uv = np.array([[loops[loop] for loop in face] for face in wanted.tolist()], dtype=np.float32)
    return ScalpFile(path, faces, torch.from_numpy(uv.reshape(-1, 3, 2)))


def _number(name: str, count: int, owner: JsonValue) -> int:
    """Parse the number of a face or loop, which is a member's name."""
    if name.isascii() and name.isdigit() and len(name) <= 10 and int(name) < count:
        return int(name)
    raise replace(owner, value=name).refuse(f"names that are numbers from 0 to {count - 1}")


def _of_polygons(source: MeshFile, numbers: list[int]) -> Int64[Tensor, " scalp"]:
    """The triangles of the named polygons."""
    return torch.from_numpy(np.flatnonzero(np.isin(source.polygon, numbers)))


def _painted(path: Path, raw: bytes, source: MeshFile) -> Int64[Tensor, " scalp"]:
    """Faces whose middle is painted bright, in the mesh's own uv (of UDIM layouts, the tile [0, 1])."""
    import cv2

    if source.mesh.corner_uv is None:
        raise InputError(f"{path}: expected a mesh with texture coordinates to apply this mask, found none.")
    image_size(path)
    try:
        image = cv2.imdecode(np.frombuffer(raw, np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{path}: expected an image that can be decoded, found a damaged one; export it again.")
    centre = source.mesh.corner_uv.mean(dim=1)
    height, width = image.shape
    column = (centre[:, 0] * width).floor().long()
    row = ((1.0 - centre[:, 1]) * height).floor().long()
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    bright = torch.from_numpy(image).float()[row.clamp(0, height - 1), column.clamp(0, width - 1)] >= PAINTED * 255
    return torch.nonzero(inside & bright).squeeze(1)
