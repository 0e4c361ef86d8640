"""A head as read from files: the mesh and, if a file names them, the faces hair grows from. No chart is made.

All commands read heads by the same rule: the mesh keeps its faces in file order, and `scalp_faces.json` beside it says
which of them are scalp, unless another file is named.
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
"""Name of the file, beside a head mesh, that lists the faces hair grows from."""
HEAD_WIDTH = 0.155
"""Width of a head, metres, from which a mesh's unit is guessed."""
UNITS = (1.0, 0.1, 0.01, 0.001, 0.0254)
"""Metres per unit, for metre, decimetre, centimetre, millimetre and inch."""
SMALLEST, LARGEST = 0.05, 0.5
"""Plausible widths of a head, metres, from a doll's to a giant's; outside, the file's unit is not the metre."""


@dataclass(frozen=True)
class HeadFile:
    """A head as read from files.

    Attributes:
        path: the mesh file.
        source: its mesh, in the file's unit, with its faces in file order.
        scalp: where hair grows; None if no file says so.
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
        """Triangles of `mesh` that hair grows from, ascending; None if no file says so."""
        return None if self.scalp is None else self.scalp.faces

    @property
    def scalp_area(self) -> float | None:
        """Area of the scalp in squares of the file's unit; None if no file says what is scalp."""
        return None if self.scalp is None else float(face_areas(self.mesh)[self.scalp.faces].sum())


def read_head_file(path: Path, scalp: Path | None = None) -> HeadFile:
    """Read a head in the file's own unit.

    Args:
        path: the mesh.
        scalp: a file that names the faces hair grows from (see `read_scalp_file`); by default `scalp_faces.json` beside
            the mesh, if it exists.

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
    """Read a head that lies in the frame of a capture or a groom, in metres; its unit is not guessed.

    Raises:
        InputError: as for `read_head_file`, or the head is obviously not in metres.
    """
    head = read_head_file(path)
    width = measure_head(head.mesh.vertices).width
    if not is_head_width(width):
        raise InputError(
            f"{path}: wrong scale: expected a head in metres, about {HEAD_WIDTH:g} wide, found one {width:.3g} wide; "
            "scale it to the frame that it is used in."
        )
    return head


def is_head_width(width: float) -> bool:
    """Whether this is a plausible width of a head in metres."""
    return SMALLEST <= width <= LARGEST


def guess_unit(vertices: Float[Tensor, "vertex 3"]) -> float:
    """Guess the metres per unit of a mesh with a head: the unit in which the head's width is most plausible."""
    width = measure_head(vertices).width
    ratios = [abs(np.log(max(width, 1e-12) * unit / HEAD_WIDTH)) for unit in UNITS]
    return UNITS[int(np.argmin(ratios))]
