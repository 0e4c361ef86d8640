"""Reads the true strands of a synthetic capture."""

from pathlib import Path

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.geometry.metres import check_metres
from neural_strands.geometry.strands import Strands

ARRAYS = (
    ArraySpec("strands", "strand point 3", kinds="fi"),
    ArraySpec("unit", "", np.float64, kinds="fiu", required=False),
)
ADVICE = "synthesize the capture again"


def read_ground_truth(path: Path) -> Strands:
    """Read `ground_truth.npz`: `strands` (strand, point, 3), root first, in multiples of `unit` metres (default 1).

    Raises:
        InputError: the file cannot be read, an array is missing, has another shape or contains numbers that are not
            finite, or the strands are not in metres.
    """
    arrays = read_npz(path, "true strands", ARRAYS, ADVICE)
    stored, unit = arrays["strands"], float(arrays.get("unit", 1.0))
    if stored.shape[1] < 2:
        raise InputError(f"{path}: expected strands of two points or more, found {stored.shape[1]}; {ADVICE}.")
    if not unit > 0:
        raise InputError(f"{path}: expected a unit of more than 0 metres, found {unit:g}; {ADVICE}.")
    with np.errstate(over="ignore"):
        points = torch.from_numpy((stored * np.float64(unit)).astype(np.float32))
    if not torch.isfinite(points).all():
        raise InputError(f"{path}: expected strands in metres, found numbers beyond single precision; {ADVICE}.")
    check_metres(path, points)
    return Strands(points)
