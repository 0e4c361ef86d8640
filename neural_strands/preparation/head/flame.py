"""Reads the FLAME head model from the pickle that its licensors provide, without running code in it.

A pickle can call any function. Here only NumPy arrays are built; every other name is replaced by an inert object, so
that the file's references to SciPy and Chumpy have no effect.
"""

import codecs
import pickle
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.input_files import read_bytes
from neural_strands.geometry.mesh import Mesh

LARGEST = 2**30
"""Largest size of the file, bytes."""
MOST_VERTICES = 200_000
ARRAY_MODULES = ("numpy.core.multiarray", "numpy._core.multiarray")


class _Inert:
    """Replaces objects of any other library: accepts any arguments and stores its state."""

    def __init__(self, *_: object, **__: object) -> None:
        self.state: Any = None

    def __setstate__(self, state: object) -> None:
        self.state = state

    def append(self, _: object) -> None:
        """Ignore an element of a list."""

    def extend(self, _: object) -> None:
        """Ignore elements of a list."""

    def __setitem__(self, _: object, __: object) -> None:
        pass


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """Replaces the function by which Python 3 pickles make bytes; other encodings could expand to any size."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"the encoding {encoding[:20]!r}")
    return codecs.encode(text, "latin1")


class _ArrayUnpickler(pickle.Unpickler):
    """Builds arrays, numbers, texts and containers, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        # NumPy's pickles name two functions that build arrays; their module differs between its versions.
        if module in ARRAY_MODULES and name == "_reconstruct":
            return np.zeros(0).__reduce__()[0]
        if module in ARRAY_MODULES and name == "scalar":
            return np.float64(0).__reduce__()[0]
        if module == "numpy" and name in ("ndarray", "dtype"):
            return getattr(np, name)
        if (module, name) == ("_codecs", "encode"):
            return _encode
        return _Inert


def read_flame(path: Path) -> Mesh:
    """Read the mean head: metres, y up, +z out of the face.

    Raises:
        InputError: the file is not a pickle of a model with `v_template` and `f`.
    """
    data = read_bytes(path, "FLAME's model", LARGEST)
    try:
        model = _ArrayUnpickler(BytesIO(data), encoding="latin1").load()
        vertices, faces = (_array(model[name]) for name in ("v_template", "f"))
    # A damaged pickle can raise almost anything.
    except Exception as error:
        raise InputError(
            f"{path}: expected FLAME's model (a pickle with v_template and f), but it cannot be read as such "
            f"({reason(error)}); download it again."
        ) from error
    shaped = vertices.ndim == faces.ndim == 2 and vertices.shape[1:] == faces.shape[1:] == (3,)
    if not shaped or not 0 < len(vertices) < MOST_VERTICES or len(faces) == 0:
        raise InputError(f"{path}: expected v_template and f of triangles, found {vertices.shape} and {faces.shape}.")
    vertices, faces = vertices.astype(np.float32), faces.astype(np.int64)
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: expected faces over finite vertices, found others; download it again.")
    return Mesh(torch.from_numpy(vertices), torch.from_numpy(faces))


def _array(value: Any) -> np.ndarray:
    """Unwrap an array, which Chumpy may have wrapped (its state has the array under `x`)."""
    if isinstance(value, _Inert):
        value = value.state["x"]
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf":
        raise ValueError(f"{type(value).__name__} in place of an array of numbers")
    return value
