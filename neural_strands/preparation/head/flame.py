"""Reads the FLAME head model from the pickle that its licensors provide, without running code in it.

A pickle can call any function. Here every name is replaced by an object that does nothing but remember its arguments,
so that the file's references to NumPy, SciPy and Chumpy have no effect. Arrays of numbers are then made from what was
remembered: NumPy's own functions for this trust the file, and crash on a damaged one.
"""

import codecs
import pickle
import pickletools
import re
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
MOST_STEPS = 20_000
"""Largest number of a pickle's instructions; FLAME's have some hundreds. Deeper nesting could exhaust the stack."""
ARRAY_MODULES = ("numpy.core.multiarray", "numpy._core.multiarray")
PLACES = ("PUT", "BINPUT", "LONG_BINPUT")
"""Instructions that name a place in the memo, a list that grows to that length."""
NUMBERS = re.compile("[iuf][1248]")
"""NumPy's codes of the numbers that are read."""


class _Inert:
    """Replaces objects of any library: accepts any arguments, and stores them and its state."""

    def __init__(self, *arguments: Any, **_: object) -> None:
        self.arguments = arguments
        self.state: Any = None

    def __setstate__(self, state: object) -> None:
        self.state = state

    def append(self, _: object) -> None:
        """Ignore an element of a list."""

    def extend(self, _: object) -> None:
        """Ignore elements of a list."""

    def __setitem__(self, _: object, __: object) -> None:
        pass


class _Array(_Inert):
    """Replaces an array: its state is (version, shape, dtype, whether in Fortran's order, bytes)."""

    def numbers(self) -> np.ndarray:
        """The array.

        Raises:
            ValueError: it does not hold numbers, or another number of bytes than its shape says.
        """
        _, shape, dtype, in_fortran_order, content = self.state
        code, order = str(dtype.arguments[0]), str(dtype.state[1])
        content = content.encode("latin1") if isinstance(content, str) else content
        if not NUMBERS.fullmatch(code) or order not in ("<", ">", "=", "|") or not isinstance(content, bytes):
            raise ValueError("an array of something else than numbers")
        return np.frombuffer(content, order + code).reshape(shape, order="F" if in_fortran_order else "C")


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """Replaces the function by which Python 3 pickles make bytes; other encodings could expand to any size."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"the encoding {encoding[:20]!r}")
    return codecs.encode(text, "latin1")


class _InertUnpickler(pickle.Unpickler):
    """Builds inert objects, numbers, texts and containers, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        # The module of the function that builds arrays differs between versions of NumPy.
        if module in ARRAY_MODULES and name == "_reconstruct":
            return _Array
        if (module, name) == ("_codecs", "encode"):
            return _encode
        return _Inert


def _check_steps(data: bytes) -> None:
    """Refuse a pickle whose instructions claim more than the file holds; the unpickler reserves whatever they claim.

    Raises:
        ValueError: an instruction is damaged, or names a place in the memo beyond the number of instructions.
    """
    for step, (code, argument, _) in enumerate(pickletools.genops(data)):
        place = argument if code.name in PLACES and argument is not None else 0
        if not max(step, place) < MOST_STEPS or place < 0:
            raise ValueError(f"more than {MOST_STEPS} instructions")


def read_flame(path: Path) -> Mesh:
    """Read the mean head: metres, y up, +z out of the face.

    Raises:
        InputError: the file is not a pickle of a model with `v_template` and `f`.
    """
    data = read_bytes(path, "FLAME's model", LARGEST)
    try:
        _check_steps(data)
        model = _InertUnpickler(BytesIO(data), encoding="latin1").load()
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
    if isinstance(value, _Inert) and not isinstance(value, _Array):
        value = value.state["x"]
    if not isinstance(value, _Array):
        raise ValueError(f"{type(value).__name__} in place of an array")
    return value.numbers()
