"""Smoothness of displacements of a mesh, as sparse equations, and their solution."""

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from neural_strands.geometry.mesh import Mesh


def laplacian(mesh: Mesh) -> sparse.csr_matrix:
    """Mean of the neighbours minus the vertex itself; zero for a vertex without faces."""
    faces = mesh.faces.numpy()
    count = len(mesh.vertices)
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([ends, ends[:, ::-1]])
    adjacent = sparse.csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (count, count))
    adjacent.data[:] = 1.0
    degree = np.asarray(adjacent.sum(axis=1)).ravel()
    scale = sparse.diags(1.0 / np.maximum(degree, 1.0))
    return (scale @ adjacent - sparse.diags((degree > 0).astype(float))).tocsr()


def factorised(system: sparse.csc_matrix) -> SuperLU:
    """The factors of a symmetric positive definite matrix, which needs no pivots."""
    return splu(system, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
