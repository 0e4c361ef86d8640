"""Segments on disk: npz for programs, PLY for MeshLab and Blender."""

from pathlib import Path

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.line_segments import LineSegments

NAMES = ("points", "directions", "confidence", "segment_id")
"""Arrays of the npz file, as LineSegments names them."""


def save_segments(path: Path, segments: LineSegments) -> None:
    """Write segments; the suffix, .npz or .ply, says how.

    The PLY is binary: vertices x y z, nx ny nz (the direction), confidence, segment_id, and one edge between the
    neighbouring points of each segment.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    arrays = {name: getattr(segments, name).detach().cpu().numpy() for name in NAMES}
    if path.suffix == ".npz":
        with atomic_file(path) as temporary:
            np.savez_compressed(temporary, **arrays)
    elif path.suffix == ".ply":
        with atomic_file(path) as temporary:
            temporary.write_bytes(_ply(arrays))
    else:
        raise InputError(f"{path}: expected a file name that ends in .npz or .ply, came {path.suffix or 'none'}.")


def load_segments(path: Path) -> LineSegments:
    """Read segments that `save_segments` wrote as npz.

    Raises:
        InputError: the file is missing or is not such a file.
    """
    try:
        with np.load(path) as stored:
            arrays = {name: torch.from_numpy(stored[name]) for name in NAMES}
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(
            f"{path}: expected line segments ({', '.join(NAMES)}), came what cannot be read ({error})."
        ) from error
    count = len(arrays["points"])
    if any(len(array) != count for array in arrays.values()):
        raise InputError(f"{path}: expected {count} values in every array, came others; run lmvs again.")
    return LineSegments(**arrays)


def _ply(arrays: dict[str, np.ndarray]) -> bytes:
    """Binary little-endian PLY."""
    vertex = np.zeros(
        len(arrays["points"]),
        dtype=[(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz", "confidence")] + [("segment_id", "<i4")],
    )
    for axis in range(3):
        vertex["xyz"[axis]] = arrays["points"][:, axis]
        vertex[("nx", "ny", "nz")[axis]] = arrays["directions"][:, axis]
    vertex["confidence"], vertex["segment_id"] = arrays["confidence"], arrays["segment_id"]
    first = np.nonzero(arrays["segment_id"][1:] == arrays["segment_id"][:-1])[0]
    edge = np.zeros(len(first), dtype=[("vertex1", "<i4"), ("vertex2", "<i4")])
    edge["vertex1"], edge["vertex2"] = first, first + 1
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property {'int' if name == 'segment_id' else 'float'} {name}" for name in vertex.dtype.names or ()]
    header += [f"element edge {len(edge)}", "property int vertex1", "property int vertex2", "end_header", ""]
    return "\n".join(header).encode() + vertex.tobytes() + edge.tobytes()
