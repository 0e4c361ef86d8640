"""Reads the size of an image from its header before decoding: a small file can unpack to gigabytes."""

import struct
import warnings
from pathlib import Path

from PIL import Image

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.input_files import check_file

MOST_PIXELS = 160_000_000
"""Largest number of pixels of an image that is read; more than any camera's sensor has."""

DENSEST = 1032
"""Bytes that one byte of a PNG's zlib stream can unpack to at most (https://zlib.net/zlib_tech.html)."""
PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Channels by the colour type in the header of a PNG."""
PNG_SIGNATURE, CHUNK, CHECKSUM = b"\x89PNG\r\n\x1a\n", struct.Struct(">I4s"), 4
"""A PNG begins with the signature; each chunk has its length, its kind, its content and a checksum of four bytes."""


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image in pixels, as stored; orientation tags are ignored.

    Raises:
        InputError: the file cannot be read, is not an image, or claims more than `MOST_PIXELS` or than its bytes can
            hold.
    """
    check_file(path, "an image")
    try:
        with warnings.catch_warnings():
            # Pillow warns from half of its own limit on.
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                width, height = image.size
                is_png = image.format == "PNG"
    except Image.DecompressionBombError as error:
        raise InputError(
            f"{path}: expected an image of at most {MOST_PIXELS} pixels, found even more; resize it."
        ) from error
    except Exception as error:
        # Each of Pillow's readers raises its own errors.
        raise InputError(
            f"{path}: expected an image such as PNG or JPEG, found something else ({reason(error)}); export it again."
        ) from error
    if not 0 < width * height <= MOST_PIXELS:
        raise InputError(
            f"{path}: expected an image of at most {MOST_PIXELS} pixels, found {width} x {height}; resize it."
        )
    if is_png and not _holds_its_claims(path, width * height):
        raise InputError(
            f"{path}: expected a complete image of {width} x {height} pixels, found only {path.stat().st_size} bytes; "
            "export it again."
        )
    return width, height


def _holds_its_claims(path: Path, pixels: int) -> bool:
    """Whether a PNG is large enough for its pixels and chunks; OpenCV reserves whatever the file claims for both."""
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(26)
        if pixels * header[24] * PNG_CHANNELS.get(header[25], 1) // 8 > DENSEST * size:
            return False
        at, kind = len(PNG_SIGNATURE), b""
        while kind != b"IEND" and at < size:
            file.seek(at)
            length, kind = CHUNK.unpack(file.read(CHUNK.size).ljust(CHUNK.size, b"\0"))
            at += CHUNK.size + length + CHECKSUM
    return at <= size
