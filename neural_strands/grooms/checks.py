"""Checks shared by all readers.

The file contains what it claims, its numbers are finite, and its strands have points and length.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.input_files import read_bytes
from neural_strands.grooms.groom import ATTRIBUTES, Groom

LARGEST = 1e9
"""Coordinates beyond this are garbage in any unit."""

Locate = Callable[[str, int], str]
"""Describes where a row of "vertices" or of an attribute is in the file, such as "byte 140"."""


def read_groom_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        InputError: it is missing, unreadable or empty.
    """
    data = read_bytes(path, "a groom file")
    if not data:
        raise InputError(f"{path}: expected a groom file, but it is empty (stops at byte 0); export it again.")
    return data


def refuse(path: Path, where: str, expected: str, found: str, advice: str = "export it again") -> InputError:
    """Build the error, one sentence, that refuses a file."""
    return InputError(f"{path}: {where}: expected {expected}, found {found}; {advice}.")


def require_bytes(path: Path, start: int, claimed: int, size: int, what: str) -> None:
    """Refuse a file whose part of `claimed` bytes at `start` runs past its end, before anything is allocated.

    Raises:
        InputError: the part does not fit.
    """
    if start + claimed > size:
        found = f"a file of {size} bytes"
        raise refuse(
            path, f"byte {start}", f"{claimed} bytes of {what}", found, "it is truncated or its header is wrong"
        )


def build_groom(
    path: Path, vertices: np.ndarray, sizes: np.ndarray, locate: Locate, attributes: Mapping[str, np.ndarray | None]
) -> Groom:
    """Check what a reader found and build a groom from it (float32, copied).

    Args:
        path: the file, for error messages.
        vertices: points of all strands, (vertex, 3).
        sizes: points of each strand; their sum is the number of vertices.
        locate: describes where a row came from.
        attributes: arrays, or None, by the attribute names of `Groom`.

    Raises:
        InputError: no strands, one-point or zero-length strands, numbers that are not finite or absurd.
    """
    if len(sizes) == 0:
        raise refuse(path, locate("vertices", 0), "at least one strand", "none", "choose a file that holds hair")
    offsets = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
    if (short := _first(sizes < 2)) is not None:
        found = f"strand {short} with {sizes[short]}"
        where = locate("vertices", int(offsets[short]))
        raise refuse(path, where, "at least two points per strand", found, "remove such strands and export again")
    if (bad := _first_bad(vertices)) is not None:
        raise refuse(path, locate("vertices", bad), "finite coordinates below 1e9", f"{_words(vertices[bad])}")
    moved = np.zeros(len(vertices), dtype=bool)
    moved[1:] = (vertices[1:] != vertices[:-1]).any(axis=1)
    moved[offsets[:-1]] = False
    if (flat := _first(~np.logical_or.reduceat(moved, offsets[:-1]))) is not None:
        found = f"strand {flat} whose {sizes[flat]} points are all the same"
        where = locate("vertices", int(offsets[flat]))
        raise refuse(path, where, "strands with a length", found, "remove such strands and export again")
    tensors = {}
    for name, values in attributes.items():
        if values is None:
            continue
        if (bad := _first_bad(values)) is not None:
            raise refuse(path, locate(name, bad), f"finite values of {name}", _words(values[bad]))
        if name == "width" and (bad := _first(values < 0)) is not None:
            raise refuse(path, locate(name, bad), "widths of zero or more", f"{values[bad]}")
        if name == "t" and (bad := _first((values < 0) | (values > 1))) is not None:
            raise refuse(path, locate(name, bad), "parameters t from 0 to 1", f"{values[bad]}")
        tensors[name] = _tensor(values)
    return Groom(_tensor(vertices), torch.from_numpy(offsets), **tensors)


def check_writable(path: Path, groom: Groom) -> None:
    """Refuse to write what no reader would accept.

    Raises:
        InputError: the groom is empty or has strands or numbers that `build_groom` refuses.
    """
    attributes = {
        name: None if (v := getattr(groom, name)) is None else v.detach().cpu().numpy() for name in ATTRIBUTES
    }
    vertices, sizes = groom.vertices.detach().cpu().float().numpy(), groom.sizes.cpu().numpy()
    build_groom(path, vertices, sizes, lambda name, row: f"row {row} of {name} to be written", attributes)


def _first(mask: Any) -> int | None:
    """Index of the first true entry."""
    index = int(mask.argmax()) if len(mask) else 0
    return index if len(mask) and mask[index] else None


def _first_bad(values: np.ndarray) -> int | None:
    """First row with a number that is not finite or absurdly large."""
    with np.errstate(invalid="ignore"):
        good = np.less(np.abs(values), LARGEST)
    return _first(~good if values.ndim == 1 else np.logical_not(good).any(axis=1))


def _words(row: Any) -> str:
    return " ".join(f"{value:g}" for value in np.atleast_1d(row))


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.array(values, dtype=np.float32, order="C"))
