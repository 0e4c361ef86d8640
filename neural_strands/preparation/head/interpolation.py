"""Points on a mesh as sparse equations of its vertices."""

import numpy as np
from jaxtyping import Float, Int64
from scipy import sparse
from torch import Tensor

from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import MeshIndex


def attached(mesh: Mesh, points: Float[Tensor, "point 3"]) -> sparse.csr_matrix:
    """The matrix (point, vertex) that interpolates the surface at the positions closest to given points."""
    if len(points) == 0:
        return sparse.csr_matrix((0, len(mesh.vertices)))
    closest = MeshIndex(mesh).closest(points.contiguous())
    return interpolation(mesh, closest.face, closest.barycentric)


def interpolation(
    mesh: Mesh, face: Int64[Tensor, " point"], barycentric: Float[Tensor, "point 3"]
) -> sparse.csr_matrix:
    """The matrix (point, vertex) that interpolates points on the faces of a mesh."""
    corners = mesh.faces[face].numpy()
    number = np.repeat(np.arange(len(corners)), 3)
    weights = barycentric.double().numpy().ravel()
    return sparse.csr_matrix((weights, (number, corners.ravel())), (len(corners), len(mesh.vertices)))
