"""A head as its files say: the mesh, and the faces hair grows from where a file names them. No chart is made.

This is the one rule for heads, whoever asks: the mesh keeps its faces in file order, and `scalp_faces.json` beside it
says which of them are scalp, unless another file is named.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.hairline import measure_head
from neural_strands.scalp.mesh_file import MeshFile, read_mesh_file
from neural_strands.scalp.scalp_file import ScalpFile, read_scalp_file

SCALP_NAME = "scalp_faces.json"
"""The file beside a head mesh that names the faces hair grows from."""
HEAD_WIDTH = 0.155
"""Metres: what the width of a head is taken to be when its unit is guessed."""
UNITS = (1.0, 0.1, 0.01, 0.001, 0.0254)
"""Metres in a metre, decimetre, centimetre, millimetre and inch."""
SMALLEST, LARGEST = 0.05, 0.5
"""Metres between which a head's width lies, from a doll's to a giant's: beyond, the file's unit is not the metre."""


@dataclass(frozen=True)
class HeadFile:
    """A head as read.

    Attributes:
        path: the mesh file.
        source: its mesh, in the file's unit, with the numbers of its faces.
        scalp: where hair grows; None where no file says so.
    """

    path: Path
    source: MeshFile
    scalp: ScalpFile | None

    @property
    def mesh(self) -> Mesh:
        """The whole head in the file's unit."""
        return self.source.mesh

    @property
    def scalp_faces(self) -> Int64[Tensor, " scalp"] | None:
        """Triangles of `mesh` that hair grows from, in rising order; None where no file says so."""
        return None if self.scalp is None else self.scalp.faces

    @property
    def scalp_area(self) -> float | None:
        """Area of the scalp in squares of the file's unit; None where no file says what is scalp."""
        return None if self.scalp is None else float(face_areas(self.mesh)[self.scalp.faces].sum())


def read_head_file(path: Path, scalp: Path | None = None) -> HeadFile:
    """Read a head in the file's own unit.

    Args:
        path: the mesh.
        scalp: what names the faces hair grows from, as `read_scalp_file` takes it; without it, `scalp_faces.json`
            beside the mesh where there is one.

    Raises:
        InputError: a file is missing or unreadable, the two contradict each other, or the scalp has no area.
    """
    source = read_mesh_file(path)
    beside = path.parent / SCALP_NAME
    if scalp is None:
        scalp = beside if beside.is_file() else None
    if scalp is None:
        return HeadFile(path, source, None)
    given = read_scalp_file(scalp, source)
    given = given.where(face_areas(source.mesh)[given.faces] > 0)
    if len(given.faces) == 0:
        raise InputError(f"{scalp}: expected a scalp with an area, found none; name the faces hair grows from.")
    return HeadFile(path, source, given)


def read_metric_head(path: Path) -> HeadFile:
    """Read a head that lies in the metres of a capture or a groom; its unit is not guessed.

    Raises:
        InputError: as `read_head_file`, or the head is obviously not in metres.
    """
    head = read_head_file(path)
    width = measure_head(head.mesh.vertices).width
    if not in_metres(width):
        raise InputError(
            f"{path}: wrong scale: expected a head in metres, about {HEAD_WIDTH:g} wide, found one {width:.3g} wide; "
            "scale it to the frame that it is used in."
        )
    return head


def in_metres(width: float) -> bool:
    """Whether a head of this width can be in metres."""
    return SMALLEST <= width <= LARGEST


def guess_unit(vertices: Float[Tensor, "vertex 3"]) -> float:
    """Metres in one unit of a mesh that holds a head: the unit that makes its width most like a head's."""
    width = measure_head(vertices).width
    ratios = [abs(np.log(max(width, 1e-12) * unit / HEAD_WIDTH)) for unit in UNITS]
    return UNITS[int(np.argmin(ratios))]
