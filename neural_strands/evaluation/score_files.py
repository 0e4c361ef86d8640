"""Reads files to score: grooms, true strands of captures, line segments."""

from collections.abc import Callable
from pathlib import Path

from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.ground_truth import read_ground_truth
from neural_strands.evaluation.oriented_points import (
    STEP,
    OrientedPoints,
    sample_curves,
    sample_segments,
    sample_strands,
)
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import array_names
from neural_strands.geometry.metres import check_metres
from neural_strands.grooms.io import read_groom
from neural_strands.lmvs.files import load_segments


def read_oriented_points(path: Path, step: float = STEP) -> OrientedPoints:
    """Read strands or line segments in metres and sample them `step` metres apart.

    Takes any groom format, `ground_truth.npz` of a capture (or the capture's folder), and line segments (.npz; as .ply
    they are read as polylines).

    Raises:
        InputError: the file cannot be read, is not in metres, or contains nothing with a direction.
    """
    if path.is_dir():
        path = path / "ground_truth.npz"
    vertices, sample = _read(path)
    # Check before sampling, which would take a hundred times the memory for centimetres.
    check_metres(path, vertices)
    try:
        sampled = sample(step)
    except ValueError as error:
        raise InputError(f"{path}: expected {error}; give a larger --step or fewer strands.") from error
    if len(sampled) == 0:
        raise InputError(f"{path}: expected strands with some length, found none; give another file.")
    return sampled


def _read(path: Path) -> tuple[Float[Tensor, "vertex 3"], Callable[[float], OrientedPoints]]:
    """The vertices of a file, and a function that samples its curves at a given step."""
    names = array_names(path)
    if "strands" in names:
        points = read_ground_truth(path).points
        return points.reshape(-1, 3), lambda step: sample_strands(points, step)
    if "segment_id" in names:
        segments = load_segments(path)
        return segments.points, lambda step: sample_segments(segments, step)
    groom = read_groom(path)
    return groom.vertices, lambda step: sample_curves(groom.vertices, groom.offsets, step)
