"""Reader of nerfstudio's `transforms.json` (also NeRF's, with `camera_angle_x`)."""

import json
import math
from pathlib import Path
from typing import Any

import torch

from neural_strands.capture.images import read_pixels
from neural_strands.capture.lens import Lens
from neural_strands.capture.view_files import ViewFiles, find_mask, rigid, undistorted_intrinsics
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera

MODELS = {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"}
"""Lens models whose parameters are a subset of fl_x, fl_y, cx, cy, k1, k2, k3, p1, p2."""


def read_transforms(path: Path) -> tuple[ViewFiles, ...]:
    """Read every frame of a `transforms.json`, in the order of the file.

    Intrinsics stand at the top or in a frame (which wins). `mask_path` of a frame is its hair mask and
    `person_mask_path` its person mask; where a frame names none, `masks/` and `person_masks/` are looked into.

    Raises:
        InputError: the file is not JSON, or a key is missing or has a wrong value.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected nerfstudio's transforms.json, but it cannot be read ({error}).") from error
    frames = document.get("frames") if isinstance(document, dict) else None
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{path}: expected a non-empty list under 'frames', came none; export the cameras again.")
    shared = {key: value for key, value in document.items() if key != "frames"}
    return tuple(_view(path, index, frame, shared) for index, frame in enumerate(frames))


def _view(path: Path, index: int, frame: Any, shared: dict[str, Any]) -> ViewFiles:
    source = f"{path}: frame {index}"
    if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
        raise InputError(f"{source}: expected a 'file_path' with the image's name, came none.")
    image_path = _image_path(path.parent, frame["file_path"])
    name = _view_name(path.parent, image_path)
    lens = _lens({**shared, **frame}, image_path, source)
    try:
        pose = torch.tensor(frame.get("transform_matrix"), dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError):
        pose = torch.zeros(0)
    if pose.shape not in ((4, 4), (3, 4)):
        raise InputError(f"{source}: expected a 4 x 4 'transform_matrix' of numbers, came something else.")
    if pose.shape[0] == 3:
        pose = torch.cat([pose, pose.new_tensor([[0.0, 0.0, 0.0, 1.0]])])
    camera = Camera.from_opengl(
        rigid(pose, source).float(), undistorted_intrinsics(lens), (lens.width, lens.height), name
    )
    return ViewFiles(
        camera,
        lens,
        image_path,
        _mask_path(path.parent, frame.get("mask_path"), "masks", name),
        _mask_path(path.parent, frame.get("person_mask_path"), "person_masks", name),
    )


def _image_path(folder: Path, name: str) -> Path:
    path = folder / name
    if not path.suffix and not path.is_file():
        return path.with_suffix(".png")
    return path


def _view_name(folder: Path, image_path: Path) -> str:
    """A view is called by its place below `images/`, as COLMAP does, or by its file name where it lies elsewhere."""
    root = folder / "images"
    if image_path.is_relative_to(root) and ".." not in image_path.relative_to(root).parts:
        return image_path.relative_to(root).as_posix()
    return image_path.name


def _mask_path(folder: Path, given: str | None, default: str, name: str) -> Path | None:
    return folder / given if given else find_mask(folder / default, name)


def _lens(values: dict[str, Any], image_path: Path, source: str) -> Lens:
    model = values.get("camera_model", "OPENCV")
    if model not in MODELS or float(values.get("k4", 0.0) or 0.0) != 0.0:
        raise InputError(
            f"{source}: expected a camera_model out of {', '.join(sorted(MODELS))} without k4, came {model}; "
            "undistort the images first (for instance with COLMAP's image_undistorter)."
        )

    def number(key: str, default: float | None = None) -> float:
        value = values.get(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{source}: expected a finite number under '{key}', came {value!r}.")
        return float(value)

    if "w" in values and "h" in values:
        width, height = int(number("w")), int(number("h"))
    else:
        height, width = read_pixels(image_path).shape[:2]
    if "fl_x" in values:
        focal_x = number("fl_x")
    elif "camera_angle_x" in values:
        focal_x = 0.5 * width / math.tan(0.5 * number("camera_angle_x"))
    else:
        raise InputError(
            f"{source}: expected the focal length under 'fl_x' (pixels) or 'camera_angle_x', came neither."
        )
    focal_y = number("fl_y", focal_x)
    if width <= 0 or height <= 0 or focal_x <= 0 or focal_y <= 0:
        raise InputError(f"{source}: expected positive sizes and focal lengths, came {width} x {height}, {focal_x}.")
    k1, k2, p1, p2, k3 = (number(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    centre = (number("cx", width / 2), number("cy", height / 2))
    return Lens((focal_x, focal_y, *centre), (k1, k2, p1, p2, k3), width, height)
