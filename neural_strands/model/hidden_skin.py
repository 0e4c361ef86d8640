"""Skin that no photograph shows because hair lies over it: the smoothest continuation of the skin around it."""

import numpy as np
import torch
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import cg
from torch import Tensor

from neural_strands.geometry.mesh import Mesh

HIDDEN, SEEN = 0.25, 0.5
"""Shares of the lines of sight to a place that hair leaves free: below the first nothing is known of the skin there,
above the second everything."""
HELD = 1.0
"""How much known values hold, compared with one edge of the mesh, which pulls its ends together."""
MEAN = 1e-6
"""How much every vertex is drawn towards the mean, on the same scale: parts without a known vertex take the mean."""
PRECISION, STEPS = 1e-5, 2000
"""Relative residual at which the solver ends, and the most steps that it takes."""


def known_share(free: Float[Tensor, " vertex"]) -> Float[Tensor, " vertex"]:
    """How much photographs tell of places to which a share of the lines of sight is free of hair."""
    share = ((free - HIDDEN) / (SEEN - HIDDEN)).clamp(0, 1)
    return share * share * (3 - 2 * share)


@torch.no_grad()
def spread(
    values: Float[Tensor, "vertex channel"], known: Float[Tensor, " vertex"], mesh: Mesh
) -> Float[Tensor, "vertex channel"]:
    """Values at all vertices of a mesh: about those given where they are known, harmonic on the mesh elsewhere.

    Args:
        values: only those of vertices that are known at all count.
        known: weight of each, from 0 to 1.
        mesh: whose edges lead values on; without any known vertex they stay as they are.
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
