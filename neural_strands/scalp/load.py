"""Loads heads from files: any mesh; its scalp is read, or found by proportions, and charted."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.chart import chart_faces
from neural_strands.scalp.hairline import scalp_faces
from neural_strands.scalp.head import Head
from neural_strands.scalp.head_file import HeadFile, guess_unit, read_head_file
from neural_strands.scalp.overlap import overlapping_faces
from neural_strands.scalp.scalp_file import ScalpFile


def load_head(path: Path | str, scalp: Path | str | None = None, scale: float | None = None) -> Head:
    """Load a head (y up, +z out of the face); its unit is guessed from its width unless `scale` is given.

    Args:
        path: a mesh file; its faces keep their order.
        scalp: file that says where hair grows: a chart, a list of faces or vertices, or a painted mask
            (`scalp.scalp_file.read_scalp_file`); by default `scalp_faces.json` beside the mesh. Without any, the scalp
            is found by proportions.
        scale: metres per unit of the file.

    Raises:
        InputError: a file is missing, unreadable or contradicts the other, or the chart overlaps itself.
    """
    if scale is not None and not 0 < scale < math.inf:
        raise InputError(f"{path}: expected a scale of more than 0 metres per unit, found {scale:g}; give another.")
    file = read_head_file(Path(path), None if scalp is None else Path(scalp))
    return chart_head(file, guess_unit(file.mesh.vertices) if scale is None else scale)


def chart_head(file: HeadFile, unit: float = 1.0) -> Head:
    """Turn a head's files into a head: find the scalp if no file names it, and chart it if no file has a chart.

    Args:
        file: mesh and scalp as read.
        unit: metres per unit of the file.

    Raises:
        InputError: no scalp is found, or the file's chart leaves [0, 1] or overlaps itself.
    """
    mesh = replace(file.mesh, vertices=file.mesh.vertices * unit)
    if file.scalp is None or file.scalp.uv is None:
        chosen = find_scalp(file)
        return Head(mesh, chosen, chart_faces(mesh, chosen))
    head = Head(mesh, file.scalp.faces, file.scalp.uv)
    _check_chart(head, file.scalp, file.source.polygon)
    return head


def _check_chart(head: Head, scalp: ScalpFile, polygon: np.ndarray) -> None:
    """Refuse a chart that leaves [0, 1] or overlaps itself, naming faces of the file.

    Raises:
        InputError: the chart leaves [0, 1] or overlaps itself.
    """
    numbers = polygon[head.scalp_faces.numpy()]
    outside = ~((head.scalp_uv >= 0) & (head.scalp_uv <= 1)).all(dim=-1).all(dim=-1)
    if outside.any():
        face = int(numbers[torch.nonzero(outside)[0, 0]])
        raise InputError(
            f"{scalp.path}: expected uv in [0, 1], found face {face} outside; scale the chart to the unit square."
        )
    pairs = overlapping_faces(head.scalp_uv)
    if len(pairs):
        shown = ", ".join(f"{numbers[a]} and {numbers[b]}" for a, b in pairs[:4].tolist())
        raise InputError(
            f"{scalp.path}: expected a scalp chart without overlaps, found {len(pairs)} overlapping pairs ({shown}); "
            "unwrap it again, or give the faces alone and a chart is made."
        )


def find_scalp(file: HeadFile) -> Int64[Tensor, " scalp"]:
    """The faces hair grows from: those that a file names or, without one, those found by proportions.

    Raises:
        InputError: no file names them, and the mesh is not an upright head.
    """
    if file.scalp is not None:
        return file.scalp.faces
    try:
        chosen = scalp_faces(file.mesh)
    except ValueError as error:
        raise InputError(
            f"{file.path}: expected an upright head (y up, +z out of the face), found no scalp; name its faces in a "
            "list."
        ) from error
    chosen = chosen[face_areas(Mesh(file.mesh.vertices, file.mesh.faces[chosen])) > 0]
    if len(chosen) == 0:
        raise InputError(f"{file.path}: expected a scalp with an area, found none; name the faces hair grows from.")
    return chosen
