"""Reading what is scored: grooms, true strands of captures, line segments."""

import zipfile
from pathlib import Path

from neural_strands.capture.ground_truth import read_ground_truth
from neural_strands.evaluation.oriented_points import (
    STEP,
    OrientedPoints,
    sample_curves,
    sample_segments,
    sample_strands,
)
from neural_strands.foundation.errors import InputError
from neural_strands.grooms.io import read_groom
from neural_strands.lmvs.files import load_segments

LARGEST_EXTENT = 5.0
"""Metres across beyond which a file cannot be hair in metres."""


def read_oriented_points(path: Path, step: float = STEP) -> OrientedPoints:
    """Read strands or line segments in metres and sample them `step` metres apart.

    Takes any groom format, `ground_truth.npz` of a capture (or the capture's folder), and line segments (.npz; as .ply
    they are read as polylines).

    Raises:
        InputError: the file does not read, is not in metres, or holds nothing with a direction.
    """
    if path.is_dir():
        path = path / "ground_truth.npz"
    names = array_names(path)
    if "strands" in names:
        sampled = sample_strands(read_ground_truth(path).points, step)
    elif "segment_id" in names:
        sampled = sample_segments(load_segments(path), step)
    else:
        groom = read_groom(path)
        sampled = sample_curves(groom.vertices, groom.offsets, step)
    if len(sampled) == 0:
        raise InputError(f"{path}: expected strands with some length, came none.")
    extent = float((sampled.points.amax(dim=0) - sampled.points.amin(dim=0)).max())
    if extent > LARGEST_EXTENT:
        raise InputError(
            f"{path}: expected hair in metres, came something {extent:.3g} across; convert it first, for instance with "
            "neural-strands convert IN OUT --scale 0.01 for centimetres."
        )
    return sampled


def array_names(path: Path) -> set[str]:
    """Names of the arrays of an npz; none for any other file."""
    if path.suffix.lower() != ".npz" or not zipfile.is_zipfile(path):
        return set()
    with zipfile.ZipFile(path) as archive:
        return {name.removesuffix(".npy") for name in archive.namelist()}
