"""`.hair` files (Cem Yuksel's HAIR format): a header of 128 bytes, then one array after the other.

Stored: points, widths ("thickness", one value per point) and colours (one value per point; reading takes the mean over
each strand, writing repeats the strand's colour), all float32. Root uv and normals cannot be stored. The header's
default thickness, transparency and colour are hints for a viewer, not measurements, and are not read.
"""

import struct
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import InputError, excerpt
from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse, require_bytes
from neural_strands.grooms.groom import Groom

HEADER = struct.Struct("<4s4I5f88s")
"""Magic, strands, points, flags, default segments, thickness, transparency, RGB, free text."""
SEGMENTS, POINTS, THICKNESS, TRANSPARENCY, COLORS = 1, 2, 4, 8, 16
"""Flags of the arrays that follow the header, in this order."""
MOST_SEGMENTS = 65535
"""The number of segments of a strand is stored in 16 bits."""


def read_hair(path: Path) -> Groom:
    """Read a `.hair` file.

    Raises:
        InputError: the file's contents contradict its header.
    """
    data = read_groom_bytes(path)
    require_bytes(path, 0, HEADER.size, len(data), "header")
    magic, strands, points, flags, default, *_ = HEADER.unpack_from(data)
    if magic != b"HAIR":
        raise refuse(path, "byte 0", "the letters HAIR", excerpt(magic), "choose a .hair file")
    if not flags & POINTS:
        raise refuse(path, "byte 12", "flags with an array of points (2)", str(flags))
    widths = {SEGMENTS: 2 * strands, POINTS: 12 * points, THICKNESS: 4 * points, TRANSPARENCY: 4 * points}
    widths[COLORS] = 12 * points
    starts, end = {}, HEADER.size
    for flag, claimed in widths.items():
        if flags & flag:
            require_bytes(path, end, claimed, len(data), f"arrays for {strands} strands and {points} points")
            starts[flag] = end
            end += claimed
    # Without an array the default applies to all strands; check it before allocating an array of that size.
    total = strands * (default + 1)
    sizes = np.zeros(0, dtype=np.int64)
    if flags & SEGMENTS:
        sizes = np.frombuffer(data, "<u2", strands, starts[SEGMENTS]).astype(np.int64) + 1
        total = int(sizes.sum())
    if total != points:
        raise refuse(path, "byte 8", f"{total} points, the sum over {strands} strands", f"{points}")
    if not flags & SEGMENTS:
        sizes = np.full(strands, default + 1, dtype=np.int64)
    widths_found = np.frombuffer(data, "<f4", points, starts[THICKNESS]) if flags & THICKNESS else None
    color = None
    if flags & COLORS:
        shades = np.frombuffer(data, "<f4", 3 * points, starts[COLORS]).reshape(-1, 3)
        color = _mean(shades, sizes)

    def locate(name: str, row: int) -> str:
        """Describe the byte of a vertex, a width, or the first colour of a strand."""
        if name == "width":
            return f"byte {starts[THICKNESS] + 4 * row}"
        if name == "color":
            return f"byte {starts[COLORS] + 12 * int(sizes[:row].sum())}"
        return f"byte {starts[POINTS] + 12 * row}"

    vertices = np.frombuffer(data, "<f4", 3 * points, starts[POINTS]).reshape(-1, 3)
    return build_groom(path, vertices, sizes, locate, {"width": widths_found, "color": color})


def write_hair(path: Path, groom: Groom) -> None:
    """Write a `.hair` file.

    Raises:
        InputError: a strand has more segments than the format can count.
    """
    sizes = groom.sizes.cpu().numpy()
    if len(groom) and int(sizes.max()) - 1 > MOST_SEGMENTS:
        message = f"expected at most {MOST_SEGMENTS} segments per strand in a .hair file, found {sizes.max() - 1}"
        raise InputError(f"{path}: {message}; resample the groom or choose another format.")
    flags = SEGMENTS | POINTS | (THICKNESS if groom.width is not None else 0)
    flags |= COLORS if groom.color is not None else 0
    header = HEADER.pack(b"HAIR", len(groom), len(groom.vertices), flags, 0, 0, 0, 1, 1, 1, b"neural-strands")
    with path.open("wb") as file:
        file.write(header)
        file.write((sizes - 1).astype("<u2").tobytes())
        file.write(groom.vertices.cpu().numpy().astype("<f4").tobytes())
        if groom.width is not None:
            file.write(groom.width.cpu().numpy().astype("<f4").tobytes())
        if groom.color is not None:
            file.write(np.repeat(groom.color.cpu().numpy().astype("<f4"), sizes, axis=0).tobytes())


def _mean(values: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Mean of each strand's rows; a value that is not finite makes the mean so, which the checks detect.

    In double precision the mean of equal float32 values is that value exactly.
    """
    if len(sizes) == 0 or int(sizes.min()) == 0:
        return np.zeros((len(sizes), 3))
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    with np.errstate(invalid="ignore"):
        return np.add.reduceat(values.astype(np.float64), starts, axis=0) / sizes[:, None]
