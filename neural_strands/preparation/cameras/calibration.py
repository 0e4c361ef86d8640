"""Calibrated photographs of one person: undistorted pictures, pinhole cameras and sparse points, in any frame and unit.

On disk, this is a folder in the layout of a capture (`transforms.json` and `images/`), and `points.npz`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from neural_strands.capture.capture import Capture
from neural_strands.capture.lens import Lens
from neural_strands.capture.view_files import rigid
from neural_strands.capture.writer import IMAGES, CaptureWriter
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import ArraySpec, read_npz
from neural_strands.foundation.progress import track
from neural_strands.geometry.cameras import Camera, rigid_inverse
from neural_strands.preparation.cameras.exposures import equalised, largest_difference
from neural_strands.preparation.photographs.folder import FEWEST, Photograph, read_picture, write_picture
from neural_strands.preparation.photographs.names import stem_of
from neural_strands.preparation.stage import ADVICE

POINTS = "points.npz"
SAME_SHAPE = 0.01
"""Largest relative difference between the aspect ratios of a photograph and its camera."""


@dataclass(frozen=True)
class PosedLens:
    """A lens and its pose: the camera of one photograph.

    Attributes:
        lens: intrinsics and distortion, for the size of the picture that was calibrated.
        world_to_camera: (4, 4) rigid, OpenCV axes.
    """

    lens: Lens
    world_to_camera: np.ndarray


@dataclass(frozen=True)
class SparsePoints:
    """Sparse points from structure from motion.

    Attributes:
        position: (point, 3) in the cameras' frame.
        colour: (point, 3) sRGB in [0, 255].
    """

    position: np.ndarray
    colour: np.ndarray

    @classmethod
    def none(cls) -> "SparsePoints":
        """No points."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))

    def save(self, folder: Path) -> None:
        """Write `points.npz`."""
        np.savez(folder / POINTS, position=self.position, colour=self.colour)

    @classmethod
    def load(cls, folder: Path) -> "SparsePoints":
        """Read what `save` wrote.

        Raises:
            InputError: the file is missing or damaged.
        """
        specs = (ArraySpec("position", "point 3", np.float64), ArraySpec("colour", "point 3", np.uint8, "u"))
        arrays = read_npz(folder / POINTS, "sparse points", specs, ADVICE)
        return cls(arrays["position"], arrays["colour"])


@dataclass(frozen=True)
class Calibration:
    """Undistorted pictures with pinhole cameras.

    Attributes:
        cameras: in the order of `pictures`; in the unit of the frame, which is often arbitrary.
        pictures: the pictures' PNG files.
        points: sparse points in the same frame; there may be none.
    """

    cameras: tuple[Camera, ...]
    pictures: tuple[Path, ...]
    points: SparsePoints

    @classmethod
    def load(cls, folder: Path) -> "Calibration":
        """Read what `calibrate` wrote.

        Raises:
            InputError: a file is missing or damaged.
        """
        try:
            views = Capture.load(folder).files
        except InputError as error:
            raise InputError(
                f"{folder}: expected cameras of an earlier stage, found damaged ones; {ADVICE}."
            ) from error
        for view in views:
            if view.image_path != folder / IMAGES / view.image_path.name or not view.image_path.is_file():
                raise InputError(
                    f"{folder}: expected the picture of every camera, found none of {view.image_path.name}; {ADVICE}."
                )
        return cls(
            tuple(view.camera for view in views), tuple(view.image_path for view in views), SparsePoints.load(folder)
        )


def calibrate(
    images: Path,
    photographs: Sequence[Photograph],
    lenses: Mapping[str, PosedLens],
    points: SparsePoints,
    out: Path,
    say: Callable[[str], None],
    exposures: Mapping[str, Float[np.ndarray, "3"]] | None = None,
) -> None:
    """Undistort the photographs that have a camera, and write them with their pinhole cameras.

    Args:
        images: folder of the photographs.
        photographs: the photographs in that folder.
        lenses: cameras by file name: that of the photograph's source, its present one, or the first without its suffix.
        points: sparse points, in the cameras' frame.
        out: an existing folder.
        say: receives messages for the user.
        exposures: stops by which each photograph, by name, is made darker; None leaves them as they are.

    Raises:
        InputError: too few photographs have a camera, or one has another shape than its camera.
    """
    found = [(photograph, lens_of(photograph, lenses)) for photograph in photographs]
    posed = [(photograph, lens) for photograph, lens in found if lens is not None]
    missing = [photograph.source for photograph, lens in found if lens is None]
    if len(posed) < FEWEST:
        raise InputError(
            f"{len(photographs)} photographs: expected cameras for at least {FEWEST}, found {len(posed)}; the cameras' "
            f"image names must be those of the photographs (such as {photographs[0].source})."
        )
    if missing:
        more = f" and {len(missing) - 10} more" if len(missing) > 10 else ""
        say(f"No camera for {', '.join(missing[:10])}{more}: left out.")
    if exposures is not None:
        stops = largest_difference(exposures)
        say(f"Exposure or white balance differs by up to {stops:.1f} stops between photographs; they are made alike.")
    (out / IMAGES).mkdir()
    cameras = []
    for photograph, camera in track(posed, "undistorting"):
        lens, picture = camera.lens, read_picture(images / photograph.name)
        if exposures is not None and photograph.name in exposures:
            picture = equalised(picture, exposures[photograph.name])
        write_picture(out / IMAGES / photograph.name, lens.undistort(picture))
        cameras.append(
            Camera(
                torch.from_numpy(lens.undistorted_matrix()).float(),
                torch.from_numpy(camera.world_to_camera).float(),
                lens.width,
                lens.height,
                photograph.name,
            )
        )
    points.save(out)
    CaptureWriter(out).finish(cameras)


def rigid_pose(camera_to_world: np.ndarray, source: str) -> np.ndarray:
    """Invert a (4, 4) camera-to-world matrix (OpenCV axes), after making its rotation exactly orthonormal.

    Raises:
        InputError: the matrix scales, shears or mirrors; the message names `source`.
    """
    return rigid_inverse(rigid(torch.from_numpy(camera_to_world).double(), source)).numpy()


def find_lens(photograph: Photograph, lenses: Mapping[str, PosedLens]) -> PosedLens | None:
    """Find the camera of a photograph by the name of its source, its present one, or the first without its suffix."""
    stems = {stem_of(name): name for name in lenses}
    names = (photograph.source, photograph.name, stems.get(stem_of(photograph.source), ""))
    return next((lenses[name] for name in names if name in lenses), None)


def lens_of(photograph: Photograph, lenses: Mapping[str, PosedLens]) -> PosedLens | None:
    """Find the camera of a photograph, scaled to the photograph's size: it may belong to a larger or smaller copy.

    Raises:
        InputError: the aspect ratios differ.
    """
    posed = find_lens(photograph, lenses)
    if posed is None:
        return None
    lens = posed.lens
    across, down = photograph.width / lens.width, photograph.height / lens.height
    if abs(across / down - 1.0) > SAME_SHAPE:
        raise InputError(
            f"{photograph.source}: expected the shape that its camera says ({lens.width} x {lens.height}), found "
            f"{photograph.width} x {photograph.height}; give cameras of these photographs, upright and uncropped."
        )
    fx, fy, cx, cy = lens.intrinsics
    intrinsics = (fx * across, fy * down, cx * across, cy * down)
    fitting = replace(lens, intrinsics=intrinsics, width=photograph.width, height=photograph.height)
    return replace(posed, lens=fitting)


@dataclass(frozen=True)
class Originals:
    """The photographs as they were taken, and their lenses.

    Attributes:
        photographs: the photographs, which may have been reduced since.
        lenses: their cameras, by file name (`find_lens`).
    """

    photographs: Sequence[Photograph]
    lenses: Mapping[str, PosedLens]

    def to_picture(self, name: str, pixels: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of the undistorted picture `name` for pixels of the upright photograph."""
        photograph = next(photograph for photograph in self.photographs if photograph.name == name)
        posed = lens_of(photograph, self.lenses)
        moved = photograph.scale * pixels
        return moved if posed is None else posed.lens.undistort_points(moved)
