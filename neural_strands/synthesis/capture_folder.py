"""The folder of a synthetic capture: cameras, pictures, masks, head and ground truth, written piece by piece.

transforms.json is written last, so a folder that has it is complete. synthesis.json is written first and records the
settings; a later run continues only with the same settings.
"""

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.strands import Strands
from neural_strands.scalp.head import Head

UNIT = 1e-5
"""Metres per step of the ground truth's 16-bit integers, unless the strands extend too far for it."""
SETTINGS = "synthesis.json"
"""The record of how a capture was made."""
KINDS = ("images", "masks", "person_masks")
"""The folders with one PNG per view: pictures, coverage of hair, coverage of hair and skin."""


@dataclass(frozen=True)
class CaptureFolder:
    """Paths and writers of one capture."""

    path: Path

    def begin(self, settings: dict[str, Any], overwrite: bool = False) -> None:
        """Claim the folder for these settings, or continue in it if it was started with the same settings.

        With `overwrite`, a capture with other settings is removed first; a folder with anything else is never removed.

        Raises:
            InputError: the folder holds something else, or a capture with other settings.
        """
        record = self.path / SETTINGS
        settings = json.loads(json.dumps(settings))
        if not record.exists():
            if self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
                raise InputError(
                    f"{self.path}: expected a new or empty folder, or a capture begun by synthesize, but it holds "
                    "something else; name another folder."
                )
            _write_json(record, settings)
            return
        try:
            earlier = json.loads(record.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(f"{record}: expected the settings of an earlier run, but {error}; remove it.") from error
        changed = differences(earlier, settings)
        if changed and overwrite:
            self._clear()
            _write_json(record, settings)
        elif changed:
            raise InputError(
                f"{self.path}: holds a capture with other settings ({'; '.join(changed)}); repeat those, name another "
                "folder, or pass --overwrite."
            )

    def write_scene(self, head: Head, strands: Strands) -> None:
        """Write the head, its scalp and the true strands (already quantised)."""
        _write_head(self.path / "head.obj", head.mesh)
        _write_json(self.path / "scalp_faces.json", head.scalp_faces.tolist())
        unit = unit_for(strands.points)
        with atomic_file(self.path / "ground_truth.npz") as path:
            np.savez_compressed(path, strands=_integers(strands.points, unit), unit=np.float64(unit))

    def has_view(self, camera: Camera) -> bool:
        """Whether the picture and both masks of a camera exist."""
        return all(path.exists() for path in self._view_files(camera))

    def write_view(
        self, camera: Camera, image: Float[Tensor, "height width 3"], coverage: Float[Tensor, "height width 2"]
    ) -> None:
        """Write one view's picture (sRGB) and its masks of hair and of the whole person."""
        hair, person = coverage.unbind(dim=-1)
        for path, pixels in zip(self._view_files(camera), (image.flip(-1), hair, person), strict=True):
            _write_png(path, pixels)

    def finish(self, cameras: Sequence[Camera]) -> None:
        """Write transforms.json in nerfstudio's format, with OpenGL axes."""
        first = cameras[0]
        frames = [
            {
                "file_path": f"images/{camera.name}.png",
                "mask_path": f"masks/{camera.name}.png",
                "person_mask_path": f"person_masks/{camera.name}.png",
                "transform_matrix": camera.opengl_camera_to_world.tolist(),
            }
            for camera in cameras
        ]
        lens = {"camera_model": "OPENCV", "w": first.width, "h": first.height}
        lens |= {"fl_x": float(first.intrinsics[0, 0]), "fl_y": float(first.intrinsics[1, 1])}
        lens |= {"cx": float(first.intrinsics[0, 2]), "cy": float(first.intrinsics[1, 2])}
        lens |= dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)
        _write_json(self.path / "transforms.json", {**lens, "frames": frames})

    def _clear(self) -> None:
        """Remove the files of an earlier capture, its settings last, so that an interrupted removal can be repeated."""
        for kind in KINDS:
            shutil.rmtree(self.path / kind, ignore_errors=True)
        for name in ("transforms.json", "head.obj", "scalp_faces.json", "ground_truth.npz", SETTINGS):
            (self.path / name).unlink(missing_ok=True)

    def _view_files(self, camera: Camera) -> tuple[Path, Path, Path]:
        image, hair, person = (self.path / kind / f"{camera.name}.png" for kind in KINDS)
        return image, hair, person


def quantised(strands: Strands) -> Strands:
    """The strands as the ground truth stores them, so that the same strands are rendered and written."""
    unit = unit_for(strands.points)
    points = (_integers(strands.points, unit) * np.float64(unit)).astype(np.float32)
    return replace(strands, points=torch.from_numpy(points))


def unit_for(points: Float[Tensor, "strand point 3"]) -> float:
    """Metres per step: UNIT, or more for strands further than 0.32 m from the origin, to fit in 16 bits."""
    reach = float(points.abs().max())
    return UNIT if reach <= UNIT * 32767 else float(np.float32(np.ceil(reach / 32767 / UNIT) * UNIT))


def differences(earlier: dict[str, Any], later: dict[str, Any]) -> list[str]:
    """Differences between two settings, each as "name: A there, B now"; digests only if nothing else differs."""
    names = [name for name in {**earlier, **later} if earlier.get(name) != later.get(name)]
    names = [name for name in names if not name.endswith("_digest")] or names
    return [f"{name}: {earlier.get(name)} there, {later.get(name)} now" for name in names]


def _integers(points: Float[Tensor, "strand point 3"], unit: float) -> np.ndarray:
    return np.rint(points.detach().double().cpu().numpy() / unit).astype(np.int16)


def _write_png(path: Path, pixels: Tensor) -> None:
    encoded = (pixels.clamp(0.0, 1.0) * 255 + 0.5).to(torch.uint8).cpu().contiguous().numpy()
    with atomic_file(path) as temporary:
        if not cv2.imwrite(str(temporary), encoded):
            raise InputError(f"{path}: the picture cannot be written; is the disk full?")


def _write_json(path: Path, document: Any) -> None:
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1), encoding="utf-8")


def _write_head(path: Path, mesh: Mesh) -> None:
    vertices = ["v {:.7g} {:.7g} {:.7g}\n".format(*vertex) for vertex in mesh.vertices.tolist()]
    faces = ["f {} {} {}\n".format(*face) for face in (mesh.faces + 1).tolist()]
    with atomic_file(path) as temporary:
        temporary.write_text("".join([*vertices, *faces]), encoding="utf-8")
