"""Segments on disk: npz for programs, PLY for MeshLab and Blender."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.foundation.json_files import parse_json
from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.geometry.line_segments import LineSegments

ARRAYS = (
    ArraySpec("points", "point 3", np.float32),
    ArraySpec("directions", "point 3", np.float32),
    ArraySpec("confidence", "point", np.float32),
    ArraySpec("segment_id", "point", np.int64, kinds="iu"),
)
"""Arrays of the npz file, named like the fields of `LineSegments`."""
SOURCE = ArraySpec("source", "byte", np.uint8, kinds="u", required=False)
"""What the segments were made from: JSON in UTF-8."""
DIRECTION_TOLERANCE = 0.01
"""Largest deviation of a stored direction's length from 1."""
LONGEST_NAME = 4096
"""Largest number of characters in the name of a view."""


@dataclass(frozen=True)
class SegmentsSource:
    """What line segments were made from.

    Attributes:
        views: names of the views that stereo used.
        settings: settings of stereo and growth directions, as JSON values, for the record.
    """

    views: tuple[str, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)


def save_segments(path: Path, segments: LineSegments, source: SegmentsSource | None = None) -> None:
    """Write segments as .npz or .ply, depending on the suffix.

    The PLY is binary: vertices x y z, nx ny nz (the direction), confidence, segment_id, and one edge between the
    neighbouring points of each segment.

    Args:
        path: the file.
        segments: the segments to write.
        source: what they were made from, if known; only stored in npz.

    Raises:
        InputError: the suffix is neither, or the file cannot be written.
    """
    arrays = {spec.name: getattr(segments, spec.name).detach().cpu().numpy() for spec in ARRAYS}
    if path.suffix == ".npz":
        if source is not None:
            arrays[SOURCE.name] = np.frombuffer(json.dumps(asdict(source)).encode(), np.uint8)
        with atomic_file(path) as temporary:
            np.savez_compressed(temporary, **arrays)
    elif path.suffix == ".ply":
        with atomic_file(path) as temporary:
            temporary.write_bytes(_ply(arrays))
    else:
        raise InputError(f"{path}: expected a file name that ends in .npz or .ply, found {path.suffix or 'none'}.")


def load_segments(path: Path) -> LineSegments:
    """Read segments that `save_segments` wrote as npz.

    Raises:
        InputError: the file cannot be read, or an array is missing, has the wrong shape or type, contains numbers that
            are not finite, or violates what `LineSegments` requires.
    """
    arrays = read_npz(path, "line segments", ARRAYS, advice="run lmvs again")
    steps = np.diff(arrays["segment_id"], prepend=-1)
    length = np.linalg.norm(arrays["directions"].astype(np.float64), axis=1)
    faults = {
        "segment_id that counts segments up from 0": (steps < 0) | (steps > 1) | (arrays["segment_id"] < 0),
        "directions of length 1": abs(length - 1) > DIRECTION_TOLERANCE,
        "confidence from 0 to 1": (arrays["confidence"] < 0) | (arrays["confidence"] > 1),
    }
    for expected, wrong in faults.items():
        if wrong.any():
            first, name = int(wrong.argmax()), expected.partition(" ")[0]
            found = arrays[name][first].tolist()
            raise InputError(f"{path}: expected {expected}, found {found} at point {first}; run lmvs again.")
    return LineSegments(**{name: torch.from_numpy(array) for name, array in arrays.items()})


def load_segments_source(path: Path) -> SegmentsSource | None:
    """Read what the segments of an npz file were made from; None if the file does not record it.

    Raises:
        InputError: the file cannot be read, or this part of it is damaged.
    """
    arrays = read_npz(path, "line segments", (SOURCE,), advice="run lmvs again")
    if SOURCE.name not in arrays:
        return None
    text = arrays[SOURCE.name].tobytes().decode("utf-8", errors="replace")
    written = parse_json(text, f"{path}: {SOURCE.name}", "the views of line segments", "run lmvs again")
    views = tuple(name.text(LONGEST_NAME) for name in written.member("views").elements())
    settings = written.member("settings").members()
    return SegmentsSource(views, {name: member.value for name, member in settings.items()})


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
