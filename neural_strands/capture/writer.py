"""Writes captures that `Capture.load` reads; each file is written atomically.

A photograph is stored in `images/` under its camera's name, sub-folders included; its masks have the same path below
`masks/` and `person_masks/`, as PNG. `transforms.json` is written last: a folder that has it is complete.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int16, Int64
from torch import Tensor

from neural_strands.capture.view_files import TORSO, WORLD_TO_ROOM
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file, write_json
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.pictures.encoding import Picture, write_png

IMAGES, HAIR_MASKS, PERSON_MASKS = "images", "masks", "person_masks"
"""Folders of the photographs, of the coverage of hair, and of the coverage of the whole person."""
FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
"""Suffixes with which a camera's name is already a file name; other names get ".png" appended."""
UNIT = 1e-5
"""Metres per step of the true strands' 16-bit integers, unless the strands extend too far for it."""

Source = Picture | Path
"""A picture, or a file that is copied unchanged."""


@dataclass(frozen=True)
class CaptureWriter:
    """Writes a capture into a folder.

    Attributes:
        folder: the capture's folder, created when the first file is written.
    """

    folder: Path

    def write_view(
        self, camera: Camera, image: Source, hair_mask: Source | None = None, person_mask: Source | None = None
    ) -> None:
        """Write a view's photograph and its masks, and remove masks left by an earlier view of this name.

        Args:
            camera: names the files; without lens distortion.
            image: sRGB; a file in the format of the camera's suffix, or a picture if that suffix is PNG or missing.
            hair_mask: coverage of hair, if it is known; files are PNG.
            person_mask: coverage of the whole person, if it is known; files are PNG.

        Raises:
            InputError: a file cannot be written, or one that is to be copied cannot be read.
            ValueError: a picture has another size than the camera, or a file another format than its name.
        """
        for path, source in zip(view_files(self.folder, camera), (image, hair_mask, person_mask), strict=True):
            if source is None:
                path.unlink(missing_ok=True)
            elif isinstance(source, Path):
                _copy(source, path)
            else:
                _write_picture(path, source, camera)

    def write_head(self, mesh: Mesh, scalp_faces: Int64[Tensor, " scalp"] | None = None) -> None:
        """Write `head.obj`, world metres, and the faces that hair grows from, if they are known.

        Raises:
            InputError: a file cannot be written.
        """
        with atomic_file(self.folder / "head.obj") as path:
            path.write_text("".join(_obj_lines(mesh)), encoding="utf-8")
        if scalp_faces is None:
            (self.folder / "scalp_faces.json").unlink(missing_ok=True)
        else:
            write_json(self.folder / "scalp_faces.json", scalp_faces.tolist())

    def write_ground_truth(self, strands: Strands) -> None:
        """Write the true strands, world metres, rounded like `quantised`.

        Raises:
            InputError: the file cannot be written.
        """
        unit = _unit(strands.points)
        with atomic_file(self.folder / "ground_truth.npz") as path:
            np.savez_compressed(path, strands=_steps(strands.points, unit), unit=np.float64(unit))

    def finish(self, cameras: Sequence[Camera]) -> None:
        """Write `transforms.json` (nerfstudio's, OpenGL axes) for the views that were written.

        Args:
            cameras: cameras of all views, in the order that the capture will have.

        Raises:
            InputError: the file cannot be written.
            ValueError: a camera has skewed axes, which the format cannot express, or two views share a file.
        """
        name, count = Counter(_mask_name(camera) for camera in cameras).most_common(1)[0]
        if count > 1:
            raise ValueError(f"expected names that differ in more than their format, found {count} of {name}")
        lenses = [_lens(camera) for camera in cameras]
        alike = all(lens == lenses[0] for lens in lenses)
        frames = [
            {**self._paths(camera), **({} if alike else lens), **_poses(camera)}
            for camera, lens in zip(cameras, lenses, strict=True)
        ]
        distortion = dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)
        common = {"camera_model": "OPENCV", **(lenses[0] if alike else {}), **distortion}
        write_json(self.folder / "transforms.json", {**common, "frames": frames})

    def _paths(self, camera: Camera) -> dict[str, str]:
        """A frame's files under the keys of `transforms.json`; masks only if they exist."""
        image, *masks = view_files(self.folder, camera)
        found = {"file_path": image} | {
            key: path for key, path in zip(("mask_path", "person_mask_path"), masks, strict=True) if path.is_file()
        }
        return {key: path.relative_to(self.folder).as_posix() for key, path in found.items()}


def view_files(folder: Path, camera: Camera) -> tuple[Path, Path, Path]:
    """Paths of a view's photograph, hair mask and person mask in a capture's folder.

    Raises:
        ValueError: the camera's name is not a path below a folder.
    """
    mask = _mask_name(camera)
    return folder / IMAGES / _image_name(camera), folder / HAIR_MASKS / mask, folder / PERSON_MASKS / mask


def _image_name(camera: Camera) -> str:
    path = PurePosixPath(camera.name)
    if not path.name or path.is_absolute() or ".." in path.parts or "\\" in camera.name:
        raise ValueError(f"expected a camera whose name can be a file's, found '{camera.name}'")
    return str(path) if path.suffix.lower() in FORMATS else f"{path}.png"


def _mask_name(camera: Camera) -> str:
    return str(PurePosixPath(_image_name(camera)).with_suffix(".png"))


def quantised(strands: Strands) -> Strands:
    """Round strands as the ground truth stores them, so that the same strands are rendered and written."""
    unit = _unit(strands.points)
    points = (_steps(strands.points, unit) * np.float64(unit)).astype(np.float32)
    return replace(strands, points=torch.from_numpy(points))


def _copy(source: Path, path: Path) -> None:
    if FORMATS.get(source.suffix.lower()) != FORMATS[path.suffix.lower()]:
        raise ValueError(f"expected a {FORMATS[path.suffix.lower()]} file to become {path}, found {source}")
    try:
        content = source.read_bytes()
    except OSError as error:
        raise InputError(f"{source}: expected an image, but it cannot be read ({error.strerror}).") from error
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)


def _write_picture(path: Path, picture: Picture, camera: Camera) -> None:
    height, width = picture.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise ValueError(
            f"{path}: expected {camera.width} x {camera.height} pixels as its camera has, found {width} x {height}"
        )
    write_png(path, picture)


def _lens(camera: Camera) -> dict[str, int | float]:
    """Size and intrinsics under nerfstudio's names."""
    (fl_x, skew, cx), (_, fl_y, cy), _ = camera.intrinsics.tolist()
    if skew:
        raise ValueError(f"{camera.name}: expected axes at right angles, found a skew of {skew} pixels")
    return {"w": camera.width, "h": camera.height, "fl_x": fl_x, "fl_y": fl_y, "cx": cx, "cy": cy}


def _poses(camera: Camera) -> dict[str, Any]:
    """The pose, and how the person had moved if they had; nerfstudio has no keys for that."""
    poses: dict[str, Any] = {"transform_matrix": camera.opengl_camera_to_world.tolist()}
    if camera.world_to_room is not None:
        poses[WORLD_TO_ROOM] = camera.world_to_room.tolist()
    if camera.torso is not None:
        poses[TORSO] = {"motion": camera.torso.motion.tolist(), "neck": camera.torso.neck.tolist()}
    return poses


def _obj_lines(mesh: Mesh) -> Iterable[str]:
    """Lines of a Wavefront OBJ with all digits of single precision."""
    for vertex in mesh.vertices.tolist():
        yield "v {:.9g} {:.9g} {:.9g}\n".format(*vertex)
    faces = mesh.faces + 1
    if mesh.corner_uv is None:
        for face in faces.tolist():
            yield "f {} {} {}\n".format(*face)
        return
    places, index = torch.unique(mesh.corner_uv.reshape(-1, 2), dim=0, return_inverse=True)
    for place in places.tolist():
        yield "vt {:.9g} {:.9g}\n".format(*place)
    for corners in torch.stack([faces, index.reshape(-1, 3) + 1], dim=-1).flatten(1).tolist():
        yield "f {}/{} {}/{} {}/{}\n".format(*corners)


def _unit(points: Float[Tensor, "strand point 3"]) -> float:
    """Metres per step: UNIT, or more for strands further than 0.32 m from the origin, to fit in 16 bits."""
    reach = float(points.abs().max())
    return UNIT if reach <= UNIT * 32767 else float(np.float32(np.ceil(reach / 32767 / UNIT) * UNIT))


def _steps(points: Float[Tensor, "strand point 3"], unit: float) -> Int16[np.ndarray, "strand point 3"]:
    return np.rint(points.detach().double().cpu().numpy() / unit).astype(np.int16)
