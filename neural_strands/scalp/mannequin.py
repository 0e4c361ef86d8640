"""The built-in mannequin: head and shoulders from smoothly blended solids, meshed in code.

Origin at the middle of the head, between the ears; metres, y up, +z out of the face. The crown is at y = 0.12, the
chin at y = -0.11, the tips of the shoulders at x = +-0.21. Watertight, the bust cut flat below the collar bones.
"""

import functools

import numpy as np
import torch

from neural_strands.geometry.mesh import Mesh
from neural_strands.scalp.chart import chart_faces
from neural_strands.scalp.hairline import scalp_faces
from neural_strands.scalp.head import Head
from neural_strands.scalp.mannequin_shape import mannequin_distance
from neural_strands.scalp.surface_nets import surface_nets

SPACING = 0.0065
"""Metres between grid points: about the length of the mesh's edges."""

LOWER = (-0.23075, -0.2905, -0.1405)
"""Corner of the meshed box; x is symmetric about a cell's middle."""

CELLS = (71, 65, 43)
"""Cells of the box along x, y, z."""


@functools.cache
def mannequin() -> Head:
    """The mannequin, made once a process (about a second)."""
    vertices, faces = surface_nets(mannequin_distance, np.array(LOWER), SPACING, CELLS)
    mesh = Mesh(torch.from_numpy(vertices).float(), torch.from_numpy(faces))
    chosen = scalp_faces(mesh)
    return Head(mesh, chosen, chart_faces(mesh, chosen))
