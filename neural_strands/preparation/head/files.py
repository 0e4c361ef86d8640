"""Stores a head with its chart and landmarks as arrays of an .npz file, between stages."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.geometry.mesh import Mesh
from neural_strands.preparation.face.topology import LANDMARKS
from neural_strands.preparation.stage import ADVICE
from neural_strands.scalp.head import Head

HEAD_ARRAYS = (
    ArraySpec("vertices", "vertex 3", np.float32),
    ArraySpec("faces", "face 3", np.int64, "i"),
    ArraySpec("scalp_faces", "scalp", np.int64, "i"),
    ArraySpec("scalp_uv", "scalp 3 2", np.float32),
    ArraySpec("landmarks", f"{LANDMARKS} 3", np.float32, finite=False),
)


def head_arrays(head: Head, landmarks: Float[Tensor, "landmark 3"]) -> dict[str, np.ndarray]:
    """The arrays that `HEAD_ARRAYS` describes."""
    return {
        "vertices": head.mesh.vertices.numpy(),
        "faces": head.mesh.faces.numpy(),
        "scalp_faces": head.scalp_faces.numpy(),
        "scalp_uv": head.scalp_uv.numpy(),
        "landmarks": landmarks.numpy(),
    }


def read_head_arrays(path: Path, what: str, more: Sequence[ArraySpec]) -> dict[str, np.ndarray]:
    """Read the arrays of a head and others.

    Args:
        path: the file.
        what: expected content, for error messages.
        more: the arrays that the file has besides those of `HEAD_ARRAYS`.

    Raises:
        InputError: the file is missing or damaged.
    """
    arrays = read_npz(path, what, (*HEAD_ARRAYS, *more), ADVICE)
    for name, pointed in (("faces", "vertices"), ("scalp_faces", "faces")):
        numbers, most = arrays[name], len(arrays[pointed])
        if numbers.size == 0 or numbers.min() < 0 or numbers.max() >= most:
            raise InputError(f"{path}: expected {name} out of the {most} {pointed}, found others or none; {ADVICE}.")
    return arrays


def head_of(arrays: Mapping[str, np.ndarray]) -> tuple[Head, Float[Tensor, "landmark 3"]]:
    """The head and its landmarks from arrays."""
    values = {name: torch.from_numpy(array) for name, array in arrays.items()}
    mesh = Mesh(values["vertices"], values["faces"])
    return Head(mesh, values["scalp_faces"], values["scalp_uv"]), values["landmarks"]
