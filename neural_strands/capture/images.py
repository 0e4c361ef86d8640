"""Decoding of photographs and masks, and a cache of decoded images within a budget of bytes."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.capture.lens import Lens
from neural_strands.foundation.devices.transfers import sent
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.image_files import image_size
from neural_strands.foundation.input_files import read_bytes
from neural_strands.foundation.srgb import linear_samples, srgb_samples


class ImageCache:
    """The most recently used decoded images, at most `budget` bytes in total.

    An image larger than the budget is decoded at each request and not cached.
    """

    def __init__(self, budget: int) -> None:
        self.budget = budget
        self.used = 0
        self._images: OrderedDict[tuple, np.ndarray] = OrderedDict()
        self._written: dict[Path, tuple[int, int]] = {}
        self._lock = threading.Lock()

    def get(self, key: tuple, decode: Callable[[], Mapping[tuple, np.ndarray]]) -> np.ndarray:
        """Return the image cached under `key`, or decode it and cache everything that `decode` returns; read-only."""
        with self._lock:
            if key in self._images:
                self._images.move_to_end(key)
                return self._images[key]
        decoded = decode()
        with self._lock:
            for name, image in decoded.items():
                if name not in self._images and image.nbytes <= self.budget:
                    self._images[name] = image
                    self.used += image.nbytes
            while self.used > self.budget:
                self.used -= self._images.popitem(last=False)[1].nbytes
        return decoded[key]

    def check_unchanged(self, path: Path) -> None:
        """Refuse a file that has changed since it was decoded: a fit must not mix two versions of a photograph.

        Raises:
            InputError: the file was modified in between.
        """
        with suppress(OSError):
            # A missing file is reported when it is read.
            status = path.stat()
            written = (status.st_mtime_ns, status.st_size)
            if self._written.setdefault(path, written) != written:
                raise InputError(
                    f"{path}: expected the file that was read before, found that it has changed since; restore it, or "
                    "start again."
                )


def read_pixels(path: Path, size: tuple[int, int] | None = None) -> np.ndarray:
    """Read an image as stored: uint8 or uint16, (height, width, channel) with 1 to 4 channels, RGB order.

    Orientation tags are ignored because calibrations refer to the stored pixels.

    Args:
        path: the image.
        size: width and height of its camera; an image of another size is not decoded.

    Raises:
        InputError: the file cannot be read, is not an image, is too large or of another size, or has another sample
            type.
    """
    width, height = image_size(path)
    if size is not None and size != (width, height):
        raise InputError(
            f"{path}: expected {size[0]} x {size[1]} pixels as its camera says, found {width} x {height}; "
            "resize the file or scale the intrinsics."
        )
    encoded = np.frombuffer(read_bytes(path, "an image"), np.uint8)
    try:
        pixels = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.shape[:2] != (height, width):
        raise InputError(
            f"{path}: expected a complete image, found {encoded.size} bytes that do not decode as one; export it again."
        )
    if pixels.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: expected 8 or 16 bits per sample, found {pixels.dtype}; save it as PNG or JPEG.")
    if pixels.ndim == 2:
        return pixels[:, :, None]
    order = {2: [0, 1], 3: [2, 1, 0], 4: [2, 1, 0, 3]}[pixels.shape[2]]
    return np.ascontiguousarray(pixels[:, :, order])


def colour_of(pixels: np.ndarray) -> np.ndarray:
    """Three colour channels of stored pixels: grey is repeated; colour with alpha lies over black, in linear light."""
    channels = pixels.shape[2]
    colour = pixels[:, :, : 3 if channels > 2 else 1]
    if channels in (2, 4):
        share = pixels[:, :, -1:] / np.iinfo(pixels.dtype).max
        colour = srgb_samples((linear_samples(colour) * share + 0.5).astype(np.uint16), pixels.dtype)
    return np.ascontiguousarray(np.broadcast_to(colour, (*colour.shape[:2], 3)))


def alpha_of(pixels: np.ndarray) -> np.ndarray | None:
    """The alpha channel of stored pixels (height, width), if there is one."""
    return np.ascontiguousarray(pixels[:, :, -1]) if pixels.shape[2] in (2, 4) else None


def mask_of(pixels: np.ndarray) -> np.ndarray:
    """Coverage in a mask file (height, width): its alpha unless that is opaque everywhere, else its first channel."""
    alpha = alpha_of(pixels)
    if alpha is not None and alpha.min() < np.iinfo(alpha.dtype).max:
        return alpha
    return np.ascontiguousarray(pixels[:, :, 0])


def undistorted(samples: np.ndarray, lens: Lens, *, colour: bool) -> np.ndarray:
    """Stored samples as a pinhole camera sees them; colours are interpolated in linear light."""
    if not lens.distorts or not samples.size:
        return samples
    if not colour:
        return lens.undistort(samples)
    return srgb_samples(lens.undistort(linear_samples(samples)), samples.dtype)


def to_unit(image: np.ndarray) -> np.ndarray:
    """Stored samples to float32 in [0, 1]."""
    return image.astype(np.float32) / np.float32(np.iinfo(image.dtype).max)


def unit_tensor(image: np.ndarray, device: torch.device | str) -> Float[Tensor, "*size"]:
    """`to_unit` on a device; samples of 8 bits are transferred as stored, in a quarter of the bytes."""
    if torch.device(device).type == "cpu" or image.dtype != np.uint8:
        return sent(torch.from_numpy(to_unit(image)), device)
    return sent(torch.tensor(image), device).float() / 255.0


def reduced(pixels: np.ndarray, longest_side: int) -> np.ndarray:
    """Reduce pixels (height, width[, channel]) to at most `longest_side` along the longer side, in proportion."""
    height, width = pixels.shape[:2]
    scale = longest_side / max(height, width)
    if scale >= 1.0:
        return pixels
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
