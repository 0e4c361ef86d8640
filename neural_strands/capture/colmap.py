"""Reader of COLMAP sparse models, text and binary: `cameras` and `images` (points are not needed)."""

import struct
from dataclasses import dataclass
from pathlib import Path

import torch

from neural_strands.capture.lens import Lens
from neural_strands.capture.view_files import ViewFiles, find_mask, rigid, undistorted_intrinsics
from neural_strands.foundation.errors import InputError, excerpt
from neural_strands.foundation.input_files import is_file_path, read_bytes, read_text
from neural_strands.geometry.cameras import Camera

MODELS = (("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5), ("OPENCV", 8))
"""Name and number of parameters of COLMAP's camera models, in the order of the ids in binary files."""


@dataclass(frozen=True)
class ColmapImage:
    """One entry of COLMAP's `images`: world-to-camera quaternion (w, x, y, z) and translation, camera, file name."""

    pose: tuple[float, ...]
    camera_id: int
    name: str


def find_sparse_model(folder: Path) -> Path | None:
    """Find the folder with `cameras` and `images` (.bin or .txt): `sparse/0`, `sparse`, `colmap/...`, itself or `0`."""
    for name in ("sparse/0", "sparse", "colmap/sparse/0", "colmap/sparse", ".", "0"):
        for suffix in (".bin", ".txt"):
            if (folder / name / f"cameras{suffix}").is_file():
                return folder / name
    return None


def read_colmap(folder: Path, model: Path) -> tuple[ViewFiles, ...]:
    """Read every registered image of a sparse model, sorted by name; images are in `folder/images` or `folder`.

    Raises:
        InputError: a file is missing, truncated or malformed, or a camera model is not supported.
    """
    suffix = ".bin" if (model / "cameras.bin").is_file() else ".txt"
    camera_path, image_path = model / f"cameras{suffix}", model / f"images{suffix}"
    readers = (read_cameras_binary, read_images_binary) if suffix == ".bin" else (read_cameras_text, read_images_text)
    lenses = readers[0](camera_path)
    images = readers[1](image_path)
    if not images:
        raise InputError(f"{image_path}: expected registered images, found none; calibrate the photographs again.")
    root = folder / "images" if (folder / "images").is_dir() else folder
    return tuple(_view(folder, root, image, lenses, image_path) for image in sorted(images, key=lambda i: i.name))


def read_cameras_text(path: Path) -> dict[int, Lens]:
    """Read `cameras.txt`: id, model, width, height, parameters."""
    lenses = {}
    for number, line in _lines(path):
        words = line.split()
        if not words:
            continue
        try:
            identity, name, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
            parameters = [float(word) for word in words[4:]]
        except (ValueError, IndexError) as error:
            raise _malformed(path, f"line {number}", "a camera (id, model, width, height, parameters)") from error
        lenses[identity] = _lens(name, width, height, parameters, f"{path}: line {number}")
    return lenses


def read_images_text(path: Path) -> list[ColmapImage]:
    """Read `images.txt`: two lines per image, pose and name, then its 2D points (which are skipped)."""
    images = []
    lines = [(number, line) for number, line in _lines(path)]
    while lines and not lines[-1][1].strip():
        lines.pop()
    for number, line in lines[::2]:
        words = line.split(maxsplit=9)
        try:
            values = [float(word) for word in words[1:8]]
            camera_id, name = int(words[8]), words[9].strip()
        except (ValueError, IndexError) as error:
            raise _malformed(path, f"line {number}", "an image (id, quaternion, translation, camera, name)") from error
        images.append(ColmapImage(tuple(values), camera_id, name))
    return images


def read_cameras_binary(path: Path) -> dict[int, Lens]:
    """Read `cameras.bin`: a count, then id, model, width, height and parameters of each camera."""
    reader = _Reader(path)
    lenses = {}
    for _ in range(reader.count(24)):
        identity, model, width, height = reader.unpack("<IiQQ")
        name, size = MODELS[model] if 0 <= model < len(MODELS) else (f"number {model}", 0)
        lenses[identity] = _lens(name, width, height, list(reader.unpack(f"<{size}d")), str(path))
    return lenses


def read_images_binary(path: Path) -> list[ColmapImage]:
    """Read `images.bin`: a count, then id, pose, camera, zero-ended name and 2D points (skipped) of each image."""
    reader = _Reader(path)
    images = []
    for _ in range(reader.count(73)):
        _, *values, camera_id = reader.unpack("<I7dI")
        name = reader.text()
        reader.skip(24 * reader.count(24))
        images.append(ColmapImage(tuple(values), camera_id, name))
    return images


class _Reader:
    """Bounds-checked reader of a small binary file; every error names the byte."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.offset = 0
        self.data = read_bytes(path, "COLMAP's binary model")

    def unpack(self, layout: str) -> tuple:
        size = struct.calcsize(layout)
        start = self.offset
        self.skip(size)
        return struct.unpack_from(layout, self.data, start)

    def skip(self, size: int) -> None:
        if self.offset + size > len(self.data):
            raise InputError(
                f"{self.path}: expected {size} more bytes at byte {self.offset}, found the end of the file; "
                "the file is truncated, copy it again."
            )
        self.offset += size

    def count(self, smallest: int) -> int:
        """Read a number of records of at least `smallest` bytes each; rejected if the file is too short for them."""
        start = self.offset
        (number,) = self.unpack("<Q")
        if number * smallest > len(self.data) - self.offset:
            raise InputError(
                f"{self.path}: expected a count that fits the file at byte {start}, found {number}; copy it again."
            )
        return number

    def text(self) -> str:
        end = self.data.find(b"\0", self.offset)
        if end < 0:
            raise InputError(f"{self.path}: expected an image name ended by a zero at byte {self.offset}, found none.")
        name = self.data[self.offset : end].decode("utf-8", errors="replace")
        self.offset = end + 1
        return name


def _lines(path: Path) -> list[tuple[int, str]]:
    """Numbered lines without comments."""
    text = read_text(path, "COLMAP's text model")
    return [(n, line) for n, line in enumerate(text.splitlines(), start=1) if not line.lstrip().startswith("#")]


def _malformed(path: Path, place: str, expected: str) -> InputError:
    return InputError(f"{path}: {place}: expected {expected}, found something else; export the model again.")


def _lens(name: str, width: int, height: int, parameters: list[float], source: str) -> Lens:
    """Convert COLMAP's parameters to focal lengths, centre and OpenCV's coefficients."""
    known = dict(MODELS)
    if name not in known:
        raise InputError(
            f"{source}: expected a camera model out of {', '.join(known)}, found {excerpt(name)}; "
            "undistort the images first with COLMAP's image_undistorter."
        )
    if len(parameters) != known[name]:
        raise InputError(
            f"{source}: expected {known[name]} parameters for {name}, found {len(parameters)}; export the model again."
        )
    if name in ("PINHOLE", "OPENCV"):
        focal_x, focal_y, *rest = parameters
    else:
        focal_x, *rest = parameters
        focal_y = focal_x
    k1, k2, p1, p2 = (*rest[2:], 0.0, 0.0, 0.0, 0.0)[:4]
    try:
        return Lens((focal_x, focal_y, rest[0], rest[1]), (k1, k2, p1, p2, 0.0), width, height)
    except ValueError as error:
        raise InputError(f"{source}: expected {error}; export the model again.") from error


def _view(folder: Path, root: Path, image: ColmapImage, lenses: dict[int, Lens], source: Path) -> ViewFiles:
    if not is_file_path(image.name):
        raise InputError(
            f"{source}: expected names of image files, found {excerpt(image.name)}; export the model again."
        )
    if image.camera_id not in lenses:
        raise InputError(
            f"{source}: {image.name}: expected a camera listed in cameras, found {image.camera_id}; export it again."
        )
    lens = lenses[image.camera_id]
    camera = Camera.from_colmap(
        torch.tensor(image.pose[:4], dtype=torch.float64),
        torch.tensor(image.pose[4:], dtype=torch.float64),
        undistorted_intrinsics(lens).double(),
        (lens.width, lens.height),
        image.name,
    )
    pose = rigid(camera.world_to_camera, f"{source}: {image.name}").float()
    path = root / image.name
    return ViewFiles(
        Camera(camera.intrinsics.float(), pose, lens.width, lens.height, image.name),
        lens,
        path,
        find_mask(folder / "masks", image.name),
        find_mask(folder / "person_masks", image.name),
    )
