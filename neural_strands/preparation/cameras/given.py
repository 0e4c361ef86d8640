"""Cameras that another program found."""

from pathlib import Path

import numpy as np

from neural_strands.capture.colmap import find_sparse_model, read_colmap
from neural_strands.capture.transforms import read_transforms
from neural_strands.capture.view import View
from neural_strands.foundation.errors import InputError
from neural_strands.preparation.cameras.calibration import PosedLens


def read_cameras(path: Path) -> dict[str, PosedLens]:
    """Read cameras by image name: a COLMAP model (folder), or nerfstudio's transforms.json.

    Raises:
        InputError: the file is none of these, or is wrong.
    """
    if path.is_dir():
        model = find_sparse_model(path)
        if model is not None:
            return by_name(read_colmap(path, model))
        if (path / "transforms.json").is_file():
            path = path / "transforms.json"
    if path.is_file() and path.suffix.lower() == ".json":
        return by_name(read_transforms(path))
    raise InputError(f"{path}: expected cameras: a folder with a COLMAP model, or transforms.json; found neither.")


def by_name(views: tuple[View, ...]) -> dict[str, PosedLens]:
    """Lenses and poses of a capture's views."""
    return {
        view.image_path.name: PosedLens(view.lens, view.camera.world_to_camera.double().numpy().astype(np.float64))
        for view in views
    }
