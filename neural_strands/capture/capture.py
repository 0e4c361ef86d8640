"""A capture: calibrated photographs of one head, with masks, head and ground truth if known.

A folder contains `transforms.json` or a COLMAP sparse model, the images, and optionally hair masks (`masks/`), person
masks (`person_masks/`) and `ground_truth.npz`. Its head is handled by `capture.head`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.colmap import find_sparse_model, read_colmap
from neural_strands.capture.ground_truth import read_ground_truth
from neural_strands.capture.images import (
    ImageCache,
    alpha_of,
    colour_of,
    mask_of,
    read_pixels,
    undistorted,
    unit_tensor,
)
from neural_strands.capture.transforms import read_transforms
from neural_strands.capture.view_files import ViewFiles
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import Strands
from neural_strands.geometry.views import Views

CACHE_BYTES = 512 * 1024**2
"""Default size of the cache of decoded images, bytes; a megapixel of 8-bit RGB takes 3 MB."""

StoredPart = Literal["image", "alpha", "hair", "person"]
"""Parts of a view that its files contain."""


@dataclass(frozen=True)
class Capture:
    """Photographs with their cameras; images are decoded on request.

    Attributes:
        folder: the folder of the capture.
        files: the files of each view, in the order of the calibration.
        cache: decoded images, shared by every subset of this capture.
        mask_growth: distance by which hair masks are grown when they are read, as a share of a view's longer side;
            negative to shrink them.
        witnesses: number of views whose hair masks have to show that a place is empty.

    Examples:
        >>> import neural_strands as ns
        >>> capture = ns.Capture.load("capture").subset([0, 2])
        >>> [camera.name for camera in capture.cameras]
        ['000.png', '002.png']
    """

    folder: Path
    files: tuple[ViewFiles, ...]
    cache: ImageCache = field(repr=False, compare=False)
    mask_growth: float = 0.0
    witnesses: int = 1

    @classmethod
    def load(cls, folder: Path | str, cache_bytes: int = CACHE_BYTES) -> "Capture":
        """Read the calibration of a folder; no image is decoded yet.

        Args:
            folder: contains `transforms.json`, or a COLMAP model in `sparse/0`, `sparse` or itself.
            cache_bytes: size of the cache of decoded images and masks, bytes.

        Raises:
            InputError: there is no calibration, or it is malformed.
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise InputError(
                f"{folder}: expected a capture folder, found {'a file' if folder.exists() else 'nothing'}."
            )
        if (folder / "transforms.json").is_file():
            files = read_transforms(folder / "transforms.json")
        elif (model := find_sparse_model(folder)) is not None:
            files = read_colmap(folder, model)
        else:
            raise InputError(
                f"{folder}: expected transforms.json or a COLMAP model (sparse/0/cameras.bin or .txt), found neither; "
                "calibrate the photographs first, for instance with COLMAP."
            )
        return cls(folder, files, ImageCache(cache_bytes))

    def __len__(self) -> int:
        return len(self.files)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The pinhole cameras of the undistorted images."""
        return tuple(view.camera for view in self.files)

    def subset(self, indices: Sequence[int]) -> "Capture":
        """The capture with only these views, in this order; shares the cache."""
        return replace(self, files=tuple(self.files[index] for index in indices))

    def image(self, index: int, device: torch.device | str = "cpu") -> Float[Tensor, "height width 3"]:
        """The undistorted photograph, sRGB in [0, 1], on `device`; transparent pixels lie over black.

        Raises:
            InputError: the file is missing, does not decode, or has another size than its camera.
        """
        return unit_tensor(self._stored(self.files[index], "image"), device)

    def hair_mask(self, index: int, device: torch.device | str = "cpu") -> Float[Tensor, "height width"] | None:
        """Coverage of hair in [0, 1], undistorted, on `device`; None without a mask.

        Raises:
            InputError: the file is missing, does not decode, or has another size than its camera.
        """
        view = self.files[index]
        return None if view.hair_mask_path is None else unit_tensor(self._stored(view, "hair"), device)

    def person_mask(self, index: int, device: torch.device | str = "cpu") -> Float[Tensor, "height width"] | None:
        """Coverage of the person in [0, 1], undistorted, on `device`: the mask file, or the image's alpha, or None.

        An alpha channel that is opaque everywhere does not count as a mask.

        Raises:
            InputError: the file is missing, does not decode, or has another size than its camera.
        """
        view = self.files[index]
        stored = self._stored(view, "alpha" if view.person_mask_path is None else "person")
        if not stored.size or (view.person_mask_path is None and stored.min() == np.iinfo(stored.dtype).max):
            return None
        return unit_tensor(stored, device)

    def views_on(self, device: torch.device | str = "cpu") -> Views:
        """Cameras, photographs and masks on `device`; each image is read when it is requested."""
        readers = {"image": self.image, "hair_mask": self.hair_mask, "person_mask": self.person_mask}
        return Views(
            tuple(camera.to(device) for camera in self.cameras),
            tuple(view.hair_mask_path is not None for view in self.files),
            lambda index, part: readers[part](index, device),
            self.witnesses,
        )

    @cached_property
    def ground_truth(self) -> Strands | None:
        """The true strands, if they are known (synthetic captures)."""
        path = self.folder / "ground_truth.npz"
        return read_ground_truth(path) if path.is_file() else None

    def _stored(self, view: ViewFiles, part: StoredPart) -> np.ndarray:
        """Read a part of a view from the cache or its file, undistorted, as stored; an absent part is an empty array.

        A photograph and its alpha channel are decoded together, because both are usually needed. Hair masks are cached
        after growing, because a fit reads one at every step.
        """
        paths = {"hair": view.hair_mask_path, "person": view.person_mask_path}
        path = paths.get(part) or view.image_path
        growth = self.mask_growth if part == "hair" else 0.0

        def decode() -> dict[tuple, np.ndarray]:
            self.cache.check_unchanged(path)
            pixels = read_pixels(path, (view.lens.width, view.lens.height))
            if part in paths:
                parts = {part: mask_of(pixels)}
            else:
                alpha = alpha_of(pixels)
                parts = {
                    "image": colour_of(pixels),
                    "alpha": np.zeros((0, 0), pixels.dtype) if alpha is None else alpha,
                }
            straight = {name: undistorted(stored, view.lens, colour=name == "image") for name, stored in parts.items()}
            return {
                (path, name, view.lens, growth): grown(stored, round(growth * max(stored.shape)))
                for name, stored in straight.items()
            }

        return self.cache.get((path, part, view.lens, growth), decode)


def grown(mask: np.ndarray, pixels: int) -> np.ndarray:
    """Dilate a mask by a disc of `pixels` pixels, or erode it if that is negative."""
    if pixels == 0:
        return mask
    side = 2 * abs(pixels) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    return np.asarray(cv2.dilate(mask, disc) if pixels > 0 else cv2.erode(mask, disc))


def has_calibration(folder: Path) -> bool:
    """Whether a folder has a file of cameras that `Capture.load` reads; the file is not opened."""
    return (folder / "transforms.json").is_file() or find_sparse_model(folder) is not None
