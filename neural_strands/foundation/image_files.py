"""What an image's header says, before anything is decoded: a small file can unpack to gigabytes."""

import warnings
from pathlib import Path

from PIL import Image

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.input_files import check_file

MOST_PIXELS = 160_000_000
"""Pixels of the largest image that is read: more than any camera's sensor has."""


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image in pixels, as it is stored; orientation tags change nothing.

    Raises:
        InputError: the file cannot be read, is no image, or claims more than `MOST_PIXELS`.
    """
    check_file(path, "an image")
    try:
        with warnings.catch_warnings():
            # From half of its own limit on, Pillow warns.
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                width, height = image.size
    except Image.DecompressionBombError as error:
        raise InputError(
            f"{path}: expected an image of at most {MOST_PIXELS} pixels, found even more; resize it."
        ) from error
    except Exception as error:
        # Each of Pillow's readers has errors of its own.
        raise InputError(
            f"{path}: expected an image such as PNG or JPEG, found something else ({reason(error)}); export it again."
        ) from error
    if not 0 < width * height <= MOST_PIXELS:
        raise InputError(
            f"{path}: expected an image of at most {MOST_PIXELS} pixels, found {width} x {height}; resize it."
        )
    return width, height
