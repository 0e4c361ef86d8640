"""Stores a head with its chart and landmarks as arrays of an .npz file, between stages."""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.npz import ArraySpec
from neural_strands.geometry.mesh import Mesh
from neural_strands.scalp.head import Head

HEAD_ARRAYS = (
    ArraySpec("vertices", "vertex 3", np.float32),
    ArraySpec("faces", "face 3", np.int64, "i"),
    ArraySpec("scalp_faces", "scalp", np.int64, "i"),
    ArraySpec("scalp_uv", "scalp 3 2", np.float32),
    ArraySpec("landmarks", "landmark 3", np.float32, finite=False),
)
ADVICE = "remove its folder, and the stage is done again"


def head_arrays(head: Head, landmarks: Float[Tensor, "landmark 3"]) -> dict[str, np.ndarray]:
    """The arrays that `HEAD_ARRAYS` describes."""
    return {
        "vertices": head.mesh.vertices.numpy(),
        "faces": head.mesh.faces.numpy(),
        "scalp_faces": head.scalp_faces.numpy(),
        "scalp_uv": head.scalp_uv.numpy(),
        "landmarks": landmarks.numpy(),
    }


def head_of(arrays: Mapping[str, np.ndarray]) -> tuple[Head, Float[Tensor, "landmark 3"]]:
    """The head and its landmarks from arrays."""
    values = {name: torch.from_numpy(array) for name, array in arrays.items()}
    mesh = Mesh(values["vertices"], values["faces"])
    return Head(mesh, values["scalp_faces"], values["scalp_uv"]), values["landmarks"]
