"""Imports photographs from a folder: turns them upright, converts them to sRGB, limits their size, and writes PNG.

PNG is lossless for later stages, and drops the camera's metadata, such as locations.
"""

import json
import math
import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from PIL import Image, ImageCms

from neural_strands.capture.images import colour_of, mask_of, read_pixels, reduced
from neural_strands.foundation.configs import Between, config_from_json
from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.foundation.input_files import has_controls, is_file_name
from neural_strands.foundation.json_files import read_json
from neural_strands.foundation.progress import track
from neural_strands.preparation.photographs.metadata import read_metadata, upright
from neural_strands.preparation.stage import ADVICE

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp", ".heic", ".heif")
"""Suffixes of photographs, in upper or lower case."""
UNREAD = (
    *(".exr", ".hdr", ".avif", ".jxl", ".psd"),
    *(".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".pef", ".srw"),
)
"""Suffixes of pictures that are not read, such as those of high dynamic range and of cameras' raw files."""
FEWEST = 3
"""Smallest number of photographs whose cameras can be estimated."""
FILM_DIAGONAL = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film, millimetres, to which EXIF's equivalent focal length refers."""
LONGEST_FOCAL = 1e9
"""Longest focal length that is believed, pixels."""
MOST_PIXELS = 250_000_000
"""Largest number of pixels of a photograph; phones have sensors of 200 million."""
SAME_SHAPE = 0.01
"""Largest relative difference between the aspect ratios of a mask and its photograph."""
HEIC_BRANDS = (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"mif1", b"msf1")
"""What follows the word `ftyp` in a HEIC file."""
LIST = "photographs.json"
Side = Annotated[int, Between(1, 65_535)]
"""Width or height, pixels."""


@dataclass(frozen=True)
class Photograph:
    """One upright photograph.

    Attributes:
        name: unique name of its file.
        source: the file it was made from.
        width: pixels.
        height: pixels.
        focal: focal length from the metadata, pixels; 0 if unknown.
        device: make and model of the camera, empty if unknown.
        scale: width relative to that of the file it was made from.
    """

    name: str
    source: str
    width: Side
    height: Side
    focal: Annotated[float, Between(0, LONGEST_FOCAL)] = 0.0
    device: str = ""
    scale: Annotated[float, Between(1e-6, 1)] = 1.0


def find_photographs(folder: Path) -> list[Path]:
    """List the photographs of a folder, sorted by name.

    Raises:
        InputError: the folder does not exist, has too few photographs, or one has a name that cannot be stored.
    """
    if not folder.is_dir():
        raise InputError(
            f"{folder}: expected a folder of photographs, a video or the cameras of photographs, found "
            f"{'another file' if folder.exists() else 'nothing'}; check the path."
        )
    found = list_photographs(folder)
    for path in found:
        if has_controls(path.name):
            raise InputError(
                f"{folder}: expected names of photographs without control characters, found {path.name!r}; rename it."
            )
    if len(found) < FEWEST:
        unread = unread_pictures(folder)
        raise InputError(
            f"{folder}: expected at least {FEWEST} photographs of the head from different sides (24 or more are "
            f"better), found {len(found)}; "
            f"{_elsewhere(folder) or (f'export {unread} as JPEG' if unread else 'take more')}."
        )
    return found


def unread_pictures(folder: Path) -> str:
    """Name pictures in a folder whose formats are not read: "'a.exr' and 11 more"; empty if there are none.

    Those that lie beside a photograph of the same name, as raw files of cameras do, are not missed.
    """
    photographed = {path.stem.lower() for path in list_photographs(folder)}
    found = sorted(
        path.name
        for path in folder.iterdir()
        if path.suffix.lower() in UNREAD and not path.name.startswith(".") and path.stem.lower() not in photographed
    )
    more = f" and {len(found) - 1} more" if len(found) > 1 else ""
    return f"{excerpt(found[0])}{more}" if found else ""


def list_photographs(folder: Path) -> list[Path]:
    """The photographs directly in a folder, sorted by name; there may be none.

    Raises:
        InputError: the folder cannot be read.
    """
    try:
        return sorted(
            path
            for path in folder.iterdir()
            if path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and not path.is_dir()
        )
    except OSError as error:
        raise InputError(
            f"{folder}: expected a folder of photographs, found one that cannot be read ({reason(error)}); allow it, "
            "or copy them to another."
        ) from error


def _elsewhere(folder: Path) -> str:
    """Advice about photographs in folders inside a folder, which are not looked for; empty if there are none."""
    inside = [path for path in sorted(folder.iterdir()) if path.is_dir() and not path.name.startswith(".")]
    found = next((path for path in inside if os.access(path, os.R_OK) and list_photographs(path)), None)
    return f"name {found} or move all photographs of the person into one folder" if found is not None else ""


def import_photographs(
    paths: Sequence[Path], out: Path, longest_side: int, say: Callable[[str], None]
) -> list[Photograph]:
    """Write each photograph to `out` as an upright PNG, and list them in `photographs.json`.

    Files that do not decode are skipped with a message.

    Args:
        paths: photographs.
        out: an existing folder.
        longest_side: largest side afterwards, pixels.
        say: receives messages for the user.

    Raises:
        InputError: fewer than three decode, or HEIC files come without the package that reads them.
    """
    _register_heic(paths)
    photographs: list[Photograph] = []
    names: set[str] = set()
    for path in track(paths, "reading photographs"):
        try:
            with _large_pictures(), Image.open(path) as image:
                pixels, scale, focal, device = _upright(image, longest_side)
        # Depending on the damage, Pillow's decoders raise various exceptions.
        except Exception as error:
            say(f"{path.name} does not decode ({reason(error)}) and is left out.")
            continue
        name = f"{_unique(path, names)}.png"
        write_picture(out / name, pixels)
        height, width = pixels.shape[:2]
        photographs.append(Photograph(name, path.name, width, height, focal, device, scale))
    if len(photographs) < FEWEST:
        raise InputError(
            f"{paths[0].parent}: expected at least {FEWEST} photographs that decode, found {len(photographs)}; "
            "export them again as JPEG."
        )
    write_list(out, photographs)
    return photographs


def write_list(folder: Path, photographs: Sequence[Photograph]) -> None:
    """Write `photographs.json`."""
    document = [asdict(photograph) for photograph in photographs]
    (folder / LIST).write_text(json.dumps(document, indent=1), encoding="utf-8")


def read_list(folder: Path) -> list[Photograph]:
    """Read what `write_list` wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    document = read_json(folder / LIST, "the list of photographs", ADVICE)
    rows = document.elements()
    if not rows:
        raise document.refuse("at least one photograph")
    listed = [config_from_json(Photograph, row) for row in rows]
    names = Counter(photograph.name for photograph in listed)
    for row, photograph in zip(rows, listed, strict=True):
        # Later stages write files of these names; none may lead out of their folders.
        if not is_file_name(photograph.name):
            raise row.member("name").refuse("the name of a file")
        if names[photograph.name] > 1:
            raise row.member("name").refuse("another name for each photograph")
    return listed


def write_picture(path: Path, pixels: np.ndarray) -> None:
    """Write 8-bit RGB or grey pixels as PNG.

    Raises:
        OSError: the file cannot be written.
    """
    ordered = pixels[:, :, ::-1] if pixels.ndim == 3 else pixels
    encoded = cv2.imencode(".png", np.ascontiguousarray(ordered))[1]
    path.write_bytes(encoded.tobytes())


def read_picture(path: Path) -> np.ndarray:
    """Read 8-bit RGB pixels (height, width, 3) of a picture that this program wrote.

    Raises:
        InputError: the file is missing or damaged.
    """
    try:
        pixels = read_pixels(path)
    except InputError as error:
        raise InputError(
            f"{path}: expected a picture of an earlier stage, found none that can be read; remove that stage's folder."
        ) from error
    return colour_of(pixels)


def read_mask(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Read a mask (height, width), 8 bits, enlarged or reduced to the photograph's width and height.

    Raises:
        InputError: the file does not decode, or has another shape than the photograph.
    """
    mask = mask_of(read_pixels(path))
    if mask.dtype == np.uint16:
        mask = (mask // 257).astype(np.uint8)
    height, width = mask.shape
    if abs(width * size[1] / (height * size[0]) - 1.0) > SAME_SHAPE:
        raise InputError(
            f"{path}: expected the photograph's shape ({size[0]} x {size[1]}), found {width} x {height}; make masks of "
            "the upright, uncropped photographs."
        )
    if (width, height) == size:
        return mask
    return cv2.resize(mask, size, interpolation=cv2.INTER_AREA if width > size[0] else cv2.INTER_LINEAR)


def _upright(image: Image.Image, longest_side: int) -> tuple[np.ndarray, float, float, str]:
    """Return upright pixels (height, width, 3), their scale, the focal length in pixels, and the device.

    Raises:
        ValueError: samples are not of 8 or 16 bits, so that it is unknown which of them is white.
    """
    # Pillow may read 16-bit grey of a PNG into 32 bits; a TIFF has whatever it says.
    if image.mode == "F" or (image.mode == "I" and image.format != "PNG"):
        raise ValueError("expected 8 or 16 bits per sample, found 32 or numbers with a sign; export it with 8 or 16")
    metadata = read_metadata(image)
    profile = image.info.get("icc_profile")
    # Pillow turns a TIFF while it decodes it, and then forgets its orientation.
    image.load()
    image = _in_srgb(upright(image, read_metadata(image).orientation), profile)
    pixels = reduced(np.asarray(image), longest_side)
    height, width = pixels.shape[:2]
    scale = width / image.width
    focal = metadata.equivalent * math.hypot(width, height) / FILM_DIAGONAL
    return pixels, scale, focal if 0.0 < focal <= LONGEST_FOCAL else 0.0, metadata.device


@contextmanager
def _large_pictures() -> Iterator[None]:
    """Let Pillow decode pictures of the largest sensors, which it would refuse, and odd metadata without a warning."""
    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = MOST_PIXELS
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def _in_srgb(image: Image.Image, profile: bytes | None) -> Image.Image:
    """Convert to 8-bit sRGB, for phones write Display P3; a damaged profile is ignored."""
    if image.mode.startswith("I;16") or image.mode == "I":
        grey = np.asarray(image, dtype=np.float64) / 257.0
        image = Image.fromarray(np.clip(np.rint(grey), 0, 255).astype(np.uint8))
    if image.mode in ("RGBA", "LA", "PA", "P"):
        image = Image.fromarray(colour_of(np.asarray(image.convert("RGBA"))))
    image = image.convert("RGB")
    if not profile:
        return image
    try:
        source = ImageCms.ImageCmsProfile(BytesIO(profile))
        converted = ImageCms.profileToProfile(image, source, ImageCms.createProfile("sRGB"))
    except (ImageCms.PyCMSError, OSError):
        return image
    return converted or image


def _unique(path: Path, names: set[str]) -> str:
    """The file's stem, with a number appended if another file (in other case or format) already has it."""
    stem, number = path.stem, 2
    while stem.lower() in names:
        stem, number = f"{path.stem}-{number}", number + 1
    names.add(stem.lower())
    return stem


def _register_heic(paths: Sequence[Path]) -> None:
    """Enable Pillow to read HEIC if any of the files needs it, whatever its suffix: some programs write .jpg.

    Raises:
        InputError: pillow-heif is not installed.
    """
    heic = [path for path in paths if path.suffix.lower() in (".heic", ".heif") or _is_heic(path)]
    if not heic:
        return
    try:
        from pillow_heif import register_heif_opener  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise InputError(
            f"{heic[0]}: expected the package pillow-heif to read HEIC, found none; run "
            "`pip install 'neural-strands[photos]'`, or export the photographs as JPEG."
        ) from error
    register_heif_opener()


def _is_heic(path: Path) -> bool:
    """Whether a file begins as HEIC does."""
    try:
        with path.open("rb") as file:
            start = file.read(12)
    except OSError:
        return False
    return start[4:8] == b"ftyp" and start[8:12] in HEIC_BRANDS
