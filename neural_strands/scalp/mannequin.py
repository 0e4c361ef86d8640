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

GRID = (
    ((0.0, 0.0050), (0.090, 0.0050), (0.105, 0.011), (0.225, 0.011)),
    ((-0.290, 0.0110), (-0.150, 0.0090), (-0.115, 0.0050), (0.130, 0.0050)),
    ((-0.140, 0.0075), (-0.020, 0.0070), (0.020, 0.0050), (0.130, 0.0050)),
)
"""Spacing of the grid at positions along x (mirrored), y and z, metres: fine on the face and the ears."""


@functools.cache
def mannequin() -> Head:
    """Build the mannequin, once per process (about a second)."""
    x, y, z = (_axis(places) for places in GRID)
    # No grid point at x = 0: a cell straddles the plane of symmetry.
    x = x + 0.5 * (x[1] - x[0])
    vertices, faces = surface_nets(mannequin_distance, (np.concatenate([-x[::-1], x]), y, z))
    mesh = Mesh(torch.from_numpy(vertices).float(), torch.from_numpy(faces))
    chosen = scalp_faces(mesh)
    return Head(mesh, chosen, chart_faces(mesh, chosen))


def _axis(places: tuple[tuple[float, float], ...]) -> np.ndarray:
    """Grid coordinates from the first place to the last; each place is (coordinate, spacing), interpolated between."""
    coordinates, spacings = np.array(places).T
    axis = [coordinates[0]]
    while axis[-1] < coordinates[-1]:
        axis.append(axis[-1] + np.interp(axis[-1], coordinates, spacings))
    return np.array(axis)
