"""Heads from files: any mesh, with its scalp given, painted, or found."""

import gzip
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.chart import chart_faces
from neural_strands.scalp.hairline import measure_head, scalp_faces
from neural_strands.scalp.head import Head
from neural_strands.scalp.mesh_file import MeshFile, read_mesh_file
from neural_strands.scalp.overlap import overlapping_faces

HEAD_WIDTH = 0.155
"""Metres: what the width of a head is taken to be when its unit is guessed."""

UNITS = (1.0, 0.1, 0.01, 0.001, 0.0254)
"""Metres in a metre, decimetre, centimetre, millimetre and inch."""

PAINTED = 0.5
"""Brightness from which a mask's pixel is scalp."""


def load_head(path: Path | str, scalp: Path | str | None = None, scale: float | None = None) -> Head:
    """Load a head: y up, +z out of the face; units are guessed from its width unless `scale` is given.

    Args:
        path: a mesh file; its faces keep their order.
        scalp: where hair grows. A chart `.json` or `.json.gz` (face number -> loop number -> uv, MakeHuman's format); a
            `.json` list of face numbers (or {"faces": [...]}, {"vertices": [...]}), counted from 0 in file order; an
            image painted bright over the scalp in the mesh's own uv; or nothing, and the scalp is found by proportions.
        scale: metres in one unit of the file.

    Raises:
        InputError: a file is missing, unreadable or contradicts the other, or the chart overlaps itself.
    """
    path = Path(path)
    source = read_mesh_file(path)
    chart = None
    if scalp is None:
        chosen = _found(path, source.mesh)
    else:
        chosen, chart = _given(path, source, Path(scalp))
    unit = scale if scale is not None else guess_unit(source.mesh.vertices)
    mesh = replace(source.mesh, vertices=source.mesh.vertices * unit)
    solid = face_areas(Mesh(mesh.vertices, mesh.faces[chosen])) > 0
    chosen = chosen[solid]
    if len(chosen) == 0:
        raise InputError(f"{scalp or path}: expected a scalp with an area, found none; name the faces hair grows from.")
    if chart is None:
        return Head(mesh, chosen, chart_faces(mesh, chosen))
    head = Head(mesh, chosen, chart[solid])
    check_chart(head, str(scalp), source.polygon)
    return head


def check_chart(head: Head, name: str, polygon: np.ndarray | None = None) -> None:
    """Refuse a chart that leaves [0, 1] or overlaps itself, naming faces of the file.

    Raises:
        InputError: as above; `name` stands for the file, `polygon` maps the mesh's faces to the file's.
    """
    numbers = head.scalp_faces.cpu().numpy()
    if polygon is not None:
        numbers = polygon[numbers]
    outside = ((head.scalp_uv < 0) | (head.scalp_uv > 1)).any(dim=-1).any(dim=-1)
    if outside.any():
        face = int(numbers[torch.nonzero(outside)[0, 0]])
        raise InputError(
            f"{name}: expected uv in [0, 1], found face {face} outside; scale the chart to the unit square."
        )
    pairs = overlapping_faces(head.scalp_uv)
    if len(pairs):
        shown = ", ".join(f"{numbers[a]} and {numbers[b]}" for a, b in pairs[:4].tolist())
        raise InputError(
            f"{name}: expected a scalp chart without overlaps, found {len(pairs)} overlapping pairs ({shown}); "
            "unwrap it again, or give the faces alone and a chart is made."
        )


def guess_unit(vertices: Float[Tensor, "vertex 3"]) -> float:
    """Metres in one unit of a mesh that holds a head: the unit that makes its width most like a head's."""
    width = measure_head(vertices).width
    ratios = [abs(np.log(max(width, 1e-12) * unit / HEAD_WIDTH)) for unit in UNITS]
    return UNITS[int(np.argmin(ratios))]


def _found(path: Path, mesh: Mesh) -> Int64[Tensor, " scalp"]:
    try:
        return scalp_faces(mesh)
    except ValueError as error:
        raise InputError(
            f"{path}: expected an upright head (y up, +z out of the face), found no scalp; name its faces in a list."
        ) from error


def _given(
    path: Path, source: MeshFile, scalp: Path
) -> tuple[Int64[Tensor, " scalp"], Float[Tensor, "scalp 3 2"] | None]:
    """The scalp's faces, and their chart where the file holds one."""
    if not scalp.is_file():
        raise InputError(
            f"{scalp}: expected a scalp (chart, list or mask) for {path.name}, found no file; check the path."
        )
    if not scalp.name.endswith((".json", ".json.gz")):
        return _painted(path, source, scalp), None
    try:
        raw = gzip.decompress(scalp.read_bytes()) if scalp.suffix == ".gz" else scalp.read_bytes()
        content = json.loads(raw)
    except (OSError, EOFError, ValueError) as error:
        raise InputError(f"{scalp}: expected JSON, found something else ({error}).") from error
    if isinstance(content, list):
        content = {"faces": content}
    if isinstance(content, dict) and isinstance(content.get("faces"), list):
        return _of_polygons(source, _indices(content["faces"], source.polygons, "face", scalp)), None
    if isinstance(content, dict) and isinstance(content.get("vertices"), list):
        count = len(source.mesh.vertices)
        chosen = torch.zeros(count, dtype=torch.bool)
        chosen[_indices(content["vertices"], count, "vertex", scalp)] = True
        return torch.nonzero(chosen[source.mesh.faces].all(dim=1)).squeeze(1), None
    return _charted(source, content, scalp)


def _charted(source: MeshFile, content: Any, scalp: Path) -> tuple[Int64[Tensor, " scalp"], Float[Tensor, "scalp 3 2"]]:
    """Read face number -> loop number -> uv."""
    expected = "face number -> loop number -> [u, v]"
    try:
        numbers = [int(face) for face in content]
        loops = {int(loop): (float(u), float(v)) for corners in content.values() for loop, (u, v) in corners.items()}
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{scalp}: expected {expected}, or a list of faces, found {type(content).__name__}."
        ) from error
    chosen = _of_polygons(source, _indices(numbers, source.polygons, "face", scalp))
    wanted = source.loops[chosen.numpy()]
    missing = sorted(set(wanted.ravel().tolist()) - loops.keys())
    if missing:
        raise InputError(f"{scalp}: expected uv for every loop of its faces, found none for loop {missing[0]}.")
    uv = torch.tensor([[loops[loop] for loop in face] for face in wanted.tolist()], dtype=torch.float32)
    return chosen, uv.reshape(-1, 3, 2)


def _of_polygons(source: MeshFile, numbers: Int64[Tensor, " polygon"]) -> Int64[Tensor, " scalp"]:
    """The triangles of the named polygons."""
    return torch.from_numpy(np.flatnonzero(np.isin(source.polygon, numbers.numpy())))


def _indices(values: list[Any], count: int, kind: str, scalp: Path) -> Int64[Tensor, " index"]:
    if not all(isinstance(value, int) and 0 <= value < count for value in values):
        wrong = next(value for value in values if not (isinstance(value, int) and 0 <= value < count))
        raise InputError(f"{scalp}: expected {kind} numbers from 0 to {count - 1}, found {wrong!r}.")
    return torch.tensor(sorted(set(values)), dtype=torch.int64)


def _painted(path: Path, source: MeshFile, scalp: Path) -> Int64[Tensor, " scalp"]:
    """Faces whose middle is painted bright in the mesh's own uv (the tile [0, 1] of UDIM layouts)."""
    import cv2

    if source.mesh.corner_uv is None:
        raise InputError(f"{path}: expected texture coordinates to apply the mask {scalp.name}, found none.")
    image = cv2.imdecode(np.frombuffer(scalp.read_bytes(), np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise InputError(f"{scalp}: expected a JSON file or an image, found neither.")
    centre = source.mesh.corner_uv.mean(dim=1)
    height, width = image.shape
    column = (centre[:, 0] * width).floor().long()
    row = ((1.0 - centre[:, 1]) * height).floor().long()
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    bright = torch.from_numpy(image).float()[row.clamp(0, height - 1), column.clamp(0, width - 1)] >= PAINTED * 255
    return torch.nonzero(inside & bright).squeeze(1)
