"""Skin that no photograph shows because hair lies over it: the smoothest continuation of the skin around it."""

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import cg
from torch import Tensor

from neural_strands.foundation.smoothstep import smoothstep
from neural_strands.geometry.mesh import Mesh

HIDDEN, SEEN = 0.25, 0.5
"""Shares of a place's lines of sight that are free of hair: below the first nothing is known of the skin there, above
the second everything."""
HELD = 1.0
"""Weight that holds known values in place; an edge of the mesh pulls its ends together with weight 1."""
MEAN = 1e-6
"""Weight that pulls every vertex towards the mean: parts of the mesh without a known vertex take the mean."""
PRECISION, STEPS = 1e-5, 2000
"""Relative residual at which the solver stops, and its largest number of steps."""


def known_share(free: Float[Tensor, " vertex"]) -> Float[Tensor, " vertex"]:
    """How well photographs determine the skin's colour, in [0, 1], given the share of free lines of sight."""
    return smoothstep((free - HIDDEN) / (SEEN - HIDDEN))


@torch.no_grad()
def extend_over_mesh(
    values: Float[Tensor, "vertex channel"], known: Float[Tensor, " vertex"], mesh: Mesh
) -> Float[Tensor, "vertex channel"]:
    """Extend values from known vertices to all vertices of a mesh.

    Known values are nearly kept; elsewhere the result is harmonic on the mesh's edges. Without any known vertex the
    values are returned unchanged.

    Args:
        values: at the vertices; those with zero `known` are ignored.
        known: weight of each vertex, from 0 to 1.
        mesh: the mesh whose edges connect the vertices.
    """
    weight = known.double().cpu().numpy()
    if not weight.any():
        return values
    count, faces = len(mesh.vertices), mesh.faces.cpu().numpy()
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    joined = sparse.coo_matrix((np.ones(len(ends)), ends.T), (count, count)).tocsr()
    joined = ((joined + joined.T) > 0).astype(np.float64)
    given = np.where(weight[:, None] > 0, values.double().cpu().numpy(), 0.0)
    mean = weight @ given / weight.sum()
    diagonal = np.asarray(joined.sum(axis=1))[:, 0] + HELD * weight + MEAN
    matrix = sparse.diags(diagonal) - joined
    found = [
        cg(
            matrix,
            HELD * weight * channel + MEAN * middle,
            x0=np.where(weight > 0, channel, middle),
            rtol=PRECISION,
            maxiter=STEPS,
            M=sparse.diags(1 / diagonal),
        )[0]
        for channel, middle in zip(given.T, mean, strict=True)
    ]
    return torch.from_numpy(np.stack(found, axis=1)).to(values)
