"""Reader of nerfstudio's `transforms.json` (also NeRF's, with `camera_angle_x`)."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.lens import Lens
from neural_strands.capture.view_files import (
    FARTHEST,
    TORSO,
    WORLD_TO_ROOM,
    ViewFiles,
    find_mask,
    rigid,
    undistorted_intrinsics,
)
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.image_files import image_size
from neural_strands.foundation.json_files import JsonValue, read_json
from neural_strands.geometry.cameras import Camera, TorsoMotion

MODELS = ("OPENCV", "PINHOLE", "RADIAL", "SIMPLE_PINHOLE", "SIMPLE_RADIAL")
"""Lens models whose parameters are a subset of fl_x, fl_y, cx, cy, k1, k2, k3, p1, p2."""
LARGEST_SIDE = 65_535
"""Largest side of an image, pixels."""
SHORTEST_NECK = 1e-4
"""Least distance of the ends of a neck, metres."""


def read_transforms(path: Path) -> tuple[ViewFiles, ...]:
    """Read every frame of a `transforms.json`, in the order of the file.

    Intrinsics are given at the top level or in a frame, which takes precedence. `mask_path` of a frame is its hair mask
    and `person_mask_path` its person mask; without them, `masks/` and `person_masks/` are searched. `world_to_room`
    and `torso`, if there are any, say how the person had moved (`Camera`).

    Raises:
        InputError: the file is not JSON, or a key is missing or has a wrong value.
    """
    document = read_json(path, "nerfstudio's transforms.json", "export the cameras again")
    frames = document.member("frames")
    if not frames.elements():
        raise frames.refuse("a list of at least one frame")
    shared = {key: value for key, value in document.members().items() if key != "frames"}
    folder, entries = path.parent, frames.elements()
    images = [_image_path(folder, entry.member("file_path").file_path()) for entry in entries]
    names = _view_names(folder, images)
    return tuple(_view(folder, *view, shared) for view in zip(entries, images, names, strict=True))


def _view(folder: Path, frame: JsonValue, image_path: Path, name: str, shared: dict[str, JsonValue]) -> ViewFiles:
    lens = _lens(frame, shared, image_path)
    pose = _pose(frame, frame.member("transform_matrix"))
    camera = Camera.from_opengl(pose, undistorted_intrinsics(lens), (lens.width, lens.height), name)
    room = frame.optional(WORLD_TO_ROOM)
    if room is not None:
        camera = replace(camera, world_to_room=_pose(frame, room))
    torso = frame.optional(TORSO)
    if torso is not None:
        camera = replace(camera, torso=_torso(torso))
    return ViewFiles(
        camera,
        lens,
        image_path,
        _mask_path(folder, frame.optional("mask_path"), "masks", name),
        _mask_path(folder, frame.optional("person_mask_path"), "person_masks", name),
    )


def _pose(frame: JsonValue, written: JsonValue) -> Float[Tensor, "4 4"]:
    rows = written.array(None, 4)
    if len(rows) not in (3, 4):
        raise written.refuse("a matrix of 4 x 4 numbers")
    pose = torch.from_numpy(np.vstack([rows[:3], [0.0, 0.0, 0.0, 1.0]]))
    return rigid(pose, f"{frame.source}: {frame.place}").float()


def _torso(written: JsonValue) -> TorsoMotion:
    neck = written.member("neck")
    ends = torch.from_numpy(neck.array(2, 3)).float()
    if not SHORTEST_NECK < float((ends[1] - ends[0]).norm()) < FARTHEST:
        raise neck.refuse("two different points")
    return TorsoMotion(_pose(written, written.member("motion")), ends)


def _image_path(folder: Path, name: str) -> Path:
    path = folder / name
    if not path.suffix and not path.is_file():
        return path.with_suffix(".png")
    return path


def _view_names(folder: Path, images: list[Path]) -> list[str]:
    """Name views by their path below `images/`, as COLMAP does, or by their file name if they are elsewhere.

    If the file names of those elsewhere are ambiguous, their paths below the folder are used.
    """
    names = [_place(folder / "images", image) or image.name for image in images]
    if len(set(names)) == len(names):
        return names
    return [_place(folder / "images", image) or _place(folder, image) or image.name for image in images]


def _place(root: Path, path: Path) -> str | None:
    """The path relative to a folder; None if it is not below that folder."""
    below = path.is_relative_to(root) and ".." not in path.relative_to(root).parts
    return path.relative_to(root).as_posix() if below else None


def _mask_path(folder: Path, given: JsonValue | None, default: str, name: str) -> Path | None:
    if given is not None and given.value != "":
        return folder / given.file_path()
    return find_mask(folder / default, name)


def _lens(frame: JsonValue, shared: dict[str, JsonValue], image_path: Path) -> Lens:
    """The lens of a frame; the frame's values override those at the top level."""
    values = {name: value for name, value in {**shared, **frame.members()}.items() if value.value is not None}

    def number(name: str, default: float) -> float:
        return values[name].number() if name in values else default

    if "camera_model" in values:
        values["camera_model"].choice(MODELS)
    if number("k4", 0.0) != 0.0:
        raise values["k4"].refuse("a lens without k4: undistort the images first, for instance with COLMAP")
    if "w" in values and "h" in values:
        width, height = (values[name].whole(1, LARGEST_SIDE) for name in ("w", "h"))
    else:
        width, height = image_size(image_path)
    if "fl_x" not in values and "camera_angle_x" in values:
        focal_x = 0.5 * width / math.tan(0.5 * values["camera_angle_x"].number(1e-6, math.pi - 1e-6))
    elif "fl_x" in values:
        focal_x = values["fl_x"].number()
    else:
        raise frame.refuse("the focal length under 'fl_x' (pixels) or 'camera_angle_x', here or at the top")
    k1, k2, p1, p2, k3 = (number(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3"))
    centre = (number("cx", width / 2), number("cy", height / 2))
    try:
        return Lens((focal_x, number("fl_y", focal_x), *centre), (k1, k2, p1, p2, k3), width, height)
    except ValueError as error:
        raise InputError(f"{frame.source}: {frame.place}: expected {error}; {frame.advice}.") from error
