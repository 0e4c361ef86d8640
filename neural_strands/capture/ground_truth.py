"""The true strands that lie beside the photographs of a synthetic capture."""

import zipfile
from pathlib import Path

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands


def read_ground_truth(path: Path) -> Strands:
    """Read `ground_truth.npz`: `strands` (strand, point, 3), root first, times `unit` metres (1 where absent).

    Raises:
        InputError: an array is missing, has another shape, or holds numbers that are not finite.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            stored = archive["strands"]
            unit = float(archive["unit"]) if "unit" in archive.files else 1.0
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: expected an npz with 'strands' and 'unit', but it does not read so ({error})."
        ) from error
    if stored.ndim != 3 or stored.shape[2] != 3 or stored.shape[1] < 2 or stored.dtype.kind not in "if":
        raise InputError(
            f"{path}: expected 'strands' of shape (strand, point, 3), found {stored.shape} {stored.dtype}."
        )
    points = torch.from_numpy((stored * np.float64(unit)).astype(np.float32))
    if not torch.isfinite(points).all():
        raise InputError(f"{path}: expected finite strands, found numbers that are not finite.")
    return Strands(points)
