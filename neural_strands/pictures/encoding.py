"""Encodes images as PNG and WebP, for the whole package.

All arrays here are RGB; they are converted to OpenCV's BGR only for its encoders.
"""

from pathlib import Path

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8, UInt16
from torch import Tensor

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file

Picture = (
    Float[Tensor, "height width ..."] | UInt8[np.ndarray, "height width ..."] | UInt16[np.ndarray, "height width ..."]
)
"""An encoded (sRGB) image or a mask: values in [0, 1], or samples as a file stores them. No channel axis, or one of 1
(grey), 3 (RGB) or 4 channels (RGB and opacity)."""


def write_png(path: Path, picture: Picture) -> None:
    """Write a PNG atomically.

    Raises:
        InputError: `path` does not end in .png, or cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise InputError(f"{path}: expected a name that ends in .png, found '{path.suffix}'; give such a name.")
    with atomic_file(path) as temporary:
        temporary.write_bytes(encode_png(picture))


def encode_png(picture: Picture) -> bytes:
    """The bytes of a PNG file, lossless for samples of 8 and 16 bits."""
    return _encode(".png", picture, [])


def encode_webp(picture: Picture, quality: int = 85) -> bytes:
    """The bytes of a lossy WebP file; `quality` is from 1 to 100."""
    return _encode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])


def to_bytes(image: Float[Tensor, "*size"]) -> UInt8[np.ndarray, "*size"]:
    """Values in [0, 1] as 8-bit samples, rounded to the nearest; values outside are clamped."""
    return image.detach().clamp(0, 1).mul(255).add(0.5).to(torch.uint8).cpu().numpy()


def _encode(suffix: str, picture: Picture, settings: list[int]) -> bytes:
    samples = to_bytes(picture) if isinstance(picture, Tensor) else picture
    if samples.ndim == 3 and samples.shape[2] >= 3:
        samples = samples[..., [2, 1, 0, *range(3, samples.shape[2])]]
    if samples.size == 0:
        raise ValueError(f"expected an image with pixels, found one of shape {samples.shape}")
    encoded, data = cv2.imencode(suffix, np.ascontiguousarray(samples), settings)
    if not encoded:
        raise ValueError(f"expected an image that {suffix} can hold, found one of shape {samples.shape}")
    return data.tobytes()
