"""What a photograph's metadata say about the camera: how it was held, its focal length and its name.

They are often damaged, or not as the standard says. What cannot be read then counts as unknown.
"""

import contextlib
import warnings
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

ORIENTATION, MAKE, MODEL, EXIF, FOCAL_35MM = 0x0112, 0x010F, 0x0110, 0x8769, 0xA405
"""EXIF tags."""
LONGEST_DEVICE = 100
"""Longest name of a camera that is kept, characters."""
TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
"""What makes a stored picture upright, by EXIF's orientation."""


@dataclass(frozen=True)
class Metadata:
    """What is known about the camera.

    Attributes:
        orientation: EXIF's orientation, 1 to 8; 1 is upright.
        equivalent: focal length on 35 mm film, millimetres; 0 if unknown.
        device: make and model, empty if unknown.
    """

    orientation: int = 1
    equivalent: float = 0.0
    device: str = ""


def read_metadata(image: Image.Image) -> Metadata:
    """Read the metadata of an opened image; it need not be decoded."""
    orientation, equivalent, device = 1, 0.0, ""
    # Depending on the damage, Pillow raises various exceptions.
    with contextlib.suppress(Exception):
        exif = image.getexif()
        orientation = exif.get(ORIENTATION, 1)
        device = " ".join(str(exif.get(tag, "")) for tag in (MAKE, MODEL))
        equivalent = float(exif.get_ifd(EXIF).get(FOCAL_35MM, 0))
    device = "".join(letter for letter in device if letter.isprintable()).strip()[:LONGEST_DEVICE]
    return Metadata(orientation if orientation in TURNS else 1, equivalent, device)


def orientation_of(path: Path) -> int:
    """EXIF's orientation of a picture's file; 1 if it cannot be read."""
    with contextlib.suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with Image.open(path) as image:
            return read_metadata(image).orientation
    return 1


def upright(image: Image.Image, orientation: int) -> Image.Image:
    """Turn an image upright.

    Not by `ImageOps.exif_transpose`, which also rewrites the metadata, and fails if they are unusual.
    """
    return image.transpose(TURNS[orientation]) if orientation in TURNS else image
