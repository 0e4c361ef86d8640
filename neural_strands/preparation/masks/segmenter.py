"""Masks of the hair from files, or from another program."""

import shlex
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from neural_strands.capture.view_files import find_mask
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.image_files import image_size
from neural_strands.foundation.progress import track
from neural_strands.foundation.worker import last_line
from neural_strands.preparation.cameras.calibration import PosedLens, lens_of
from neural_strands.preparation.photographs.folder import SUFFIXES, Photograph, read_mask, read_picture
from neural_strands.preparation.stage import digest_files

Segmenter = Callable[[UInt8[np.ndarray, "height width 3"]], UInt8[np.ndarray, "height width"]]
"""Makes a mask of the hair, 255 where there is hair, from an RGB picture."""


@dataclass(frozen=True)
class GivenMasks:
    """Masks of the original, distorted photographs.

    Attributes:
        folder: folder of the masks, named like the photographs (NAME.png or NAME.jpg.png) or, if these are frames of a
            video, like the pictures in the stage `photographs`.
        photographs: the photographs that they belong to.
        lenses: lenses of the photographs, by name.
    """

    folder: Path
    photographs: Sequence[Photograph]
    lenses: Mapping[str, PosedLens]

    def digest(self) -> str:
        """Digest of all masks.

        Raises:
            InputError: the folder or a mask is missing.
        """
        return digest_files([self._path(photograph) for photograph in self.photographs])

    def read(self, name: str) -> np.ndarray:
        """Read and undistort the mask of a picture.

        Raises:
            InputError: it is missing, does not decode, or has another shape than the photograph.
        """
        photograph = next(photograph for photograph in self.photographs if photograph.name == name)
        lens = lens_of(photograph, self.lenses)
        mask = read_mask(self._path(photograph), (photograph.width, photograph.height))
        return mask if lens is None else lens.lens.undistort(mask)

    def _path(self, photograph: Photograph) -> Path:
        # The source of a frame is no file: its suffix says nothing, and the frames of a video share their stem.
        of_file = Path(photograph.source).suffix.lower() in SUFFIXES
        name = photograph.source if of_file else photograph.name
        path = find_mask(self.folder, name)
        if path is None:
            raise InputError(
                f"{self.folder}: expected a mask of every photograph, found none of {photograph.source}; add "
                f"{Path(name).stem}.png, white where there is hair."
            )
        return path


def check_command(command: str) -> None:
    """Check that a segmenter's command has placeholders for picture and mask.

    Raises:
        InputError: it does not.
    """
    try:
        words = shlex.split(command)
    except ValueError:
        words = []
    if not all(any(place in word for word in words) for place in ("{image}", "{mask}")):
        raise InputError(
            f"--segmenter: expected a command with {{image}} and {{mask}}, found {command[:100]!r}; write for instance "
            '--segmenter "python segment.py {image} {mask}".'
        )


def call_segmenter(segment: Segmenter, pictures: Sequence[Path]) -> Iterator[np.ndarray]:
    """Call a function on each picture.

    Args:
        segment: makes a mask from a picture.
        pictures: undistorted pictures.

    Yields:
        A mask (height, width), 8 bits, for each picture.

    Raises:
        InputError: the function returns anything else than 8 bits of the picture's height and width.
    """
    for picture in track(pictures, "segmenting"):
        pixels = read_picture(picture)
        mask = np.asarray(segment(pixels))
        if mask.dtype != np.uint8 or mask.shape != pixels.shape[:2]:
            raise InputError(
                f"segmenter: expected a mask of {pixels.shape[0]} x {pixels.shape[1]} 8-bit values for {picture.name}, "
                f"found {mask.dtype} {mask.shape}; return 255 where there is hair."
            )
        yield mask


def run_segmenter(command: str, pictures: Sequence[Path], out: Path) -> Iterator[np.ndarray]:
    """Run a command on each picture, which writes a mask that is white where there is hair.

    Args:
        command: the command line, with {image} and {mask} in place of the paths of the picture and of the PNG to write.
        pictures: undistorted pictures.
        out: an existing folder for the masks.

    Yields:
        A mask (height, width), 8 bits, for each picture.

    Raises:
        InputError: the command does not start, fails, or writes no mask of the picture's shape.
    """
    check_command(command)
    for picture in track(pictures, "segmenting"):
        mask = out / f"{picture.stem}.png"
        words = [word.replace("{image}", str(picture)).replace("{mask}", str(mask)) for word in shlex.split(command)]
        try:
            done = subprocess.run(words, capture_output=True, text=True, errors="replace", check=False)
        except OSError as error:
            raise InputError(
                f"--segmenter: expected a program, but {words[0]} does not start ({error.strerror})."
            ) from error
        if done.returncode != 0 or not mask.is_file():
            last = last_line(done.stderr, f"exit status {done.returncode}, no mask")
            raise InputError(f"--segmenter: expected a mask of {picture.name}, found: {last}.")
        yield read_mask(mask, image_size(picture))
