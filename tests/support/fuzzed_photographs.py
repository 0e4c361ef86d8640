"""Photographs and videos as cameras write them, and how `prepare` reads one of them."""

import tempfile
from pathlib import Path

import numpy as np
from coloured_video import with_colours, write_grey_video
from PIL import Image

from neural_strands.preparation.photographs.folder import Photograph, import_photographs, read_picture
from neural_strands.preparation.photographs.metadata import EXIF, FOCAL_35MM, MAKE, MODEL, ORIENTATION
from neural_strands.preparation.photographs.video import import_video

LONGEST_SIDE = 2048
HLG = 18
"""Number of that transfer (ITU-T H.273)."""


def write_photographs(folder: Path) -> None:
    """Write a photograph as JPEG, TIFF and HEIC, with metadata, and a video that states no colours and one of HLG."""
    from pillow_heif import from_pillow

    folder.mkdir()
    ramp = np.arange(48 * 64 * 3, dtype=np.uint16).reshape(48, 64, 3) % 251
    image = Image.fromarray(ramp.astype(np.uint8))
    exif = Image.Exif()
    exif[ORIENTATION], exif[MAKE], exif[MODEL] = 6, "Maker", "Camera 1"
    exif.get_ifd(EXIF)[FOCAL_35MM] = 26
    image.save(folder / "a.jpg", exif=exif)
    image.save(folder / "a.tif", exif=exif)
    from_pillow(image).save(folder / "a.heic", exif=exif.tobytes(), quality=80)
    write_grey_video(folder / "a.mp4", (40, 90, 140, 190), (64, 48))
    # FFmpeg takes seconds to begin with HLG, so another file is damaged where frames are decoded.
    (folder / "hlg.mp4").write_bytes(with_colours((folder / "a.mp4").read_bytes(), b"nclx", HLG))


def import_one(path: Path) -> object:
    """Import a photograph, as often as `prepare` needs photographs."""
    said: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        imported = import_photographs([path] * 3, Path(folder), LONGEST_SIDE, said.append)
        return _checked(imported, Path(folder), said)


def read_video(path: Path) -> object:
    """Import a video."""
    said: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        return _checked(import_video(path, Path(folder), 3, LONGEST_SIDE, said.append), Path(folder), said)


def _checked(imported: list[Photograph], folder: Path, said: list[str]) -> object:
    """The photographs, once what was said of them is fit to print and their pictures are as they say."""
    assert all(message.isprintable() for message in said)
    for photograph in imported:
        assert read_picture(folder / photograph.name).shape == (photograph.height, photograph.width, 3)
        assert max(photograph.width, photograph.height) <= LONGEST_SIDE
        assert 0 <= photograph.focal < np.inf
        assert photograph.device.isprintable()
    return imported
