"""`.tfx` files of TressFX 4: a binary header of 160 bytes with offsets, then arrays.

Stored, as float32: points (the same number for all strands; TressFX itself accepts 4, 8, 16, 32 or 64), root uv, one
width per strand (the mean along it) and one colour per strand (repeated for each vertex, with alpha 1). Root normals
cannot be stored. The fourth coordinate of a point is its inverse mass: 0 at the root, 1 elsewhere.
"""

import struct
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.checks import build_groom, read_groom_bytes, refuse, require_bytes
from neural_strands.grooms.groom import Groom

HEADER = struct.Struct("<f7I128x")
"""Version, strands, points per strand, byte offsets of positions, root uv, vertex uv, thickness, colours; reserved."""


def read_tfx(path: Path) -> Groom:
    """Read a binary `.tfx` file, version 4.

    Raises:
        InputError: the file's contents contradict its header.
    """
    data = read_groom_bytes(path)
    require_bytes(path, 0, HEADER.size, len(data), "TressFX 4 header")
    version, strands, points, at_position, at_uv, _, at_width, at_color = HEADER.unpack_from(data)
    if not 4.0 <= version < 5.0:
        raise refuse(path, "byte 0", "TressFX version 4 (binary) or the word version (text)", f"{version:g}")
    if points < 2 and strands > 0:
        raise refuse(path, "byte 8", "at least two points per strand", str(points))
    total = strands * points
    parts = {
        "vertices": (at_position, 4, total),
        "root_uv": (at_uv, 2, strands),
        "width": (at_width, 1, strands),
        "color": (at_color, 4, total),
    }
    found: dict[str, np.ndarray] = {}
    for name, (start, channels, rows) in parts.items():
        if start == 0 and name != "vertices":
            continue
        if start < HEADER.size:
            raise refuse(path, "byte 12", f"{name} after the header of {HEADER.size} bytes", f"the offset {start}")
        require_bytes(path, start, 4 * channels * rows, len(data), f"{name} of {strands} strands of {points} points")
        found[name] = np.frombuffer(data, "<f4", channels * rows, start).reshape(rows, channels)

    def locate(name: str, row: int) -> str:
        """Describe the byte of a row; widths and colours have one row per strand or vertex."""
        start, channels, _ = parts[name]
        row = {"width": row // max(points, 1), "color": row * points}.get(name, row)
        return f"byte {start + 4 * channels * row}"

    attributes = {"root_uv": found.get("root_uv")}
    if "width" in found:
        attributes["width"] = np.repeat(found["width"][:, 0], points)
    if "color" in found and strands:
        with np.errstate(invalid="ignore"):
            attributes["color"] = found["color"][:, :3].astype(np.float64).reshape(strands, points, 3).mean(axis=1)
    sizes = np.full(strands, points, dtype=np.int64)
    return build_groom(path, found["vertices"][:, :3], sizes, locate, attributes)


def write_tfx(path: Path, groom: Groom) -> None:
    """Write a binary `.tfx` file, version 4.

    Raises:
        InputError: the strands have different numbers of points.
    """
    if (size := groom.uniform_size) is None:
        advice = "resample the groom, or choose TressFX 2 text"
        raise InputError(
            f"{path}: expected strands of equal point counts for TressFX 4, found differing ones; {advice}."
        )
    position = np.ones((len(groom.vertices), 4), dtype="<f4")
    position[:, :3] = groom.vertices.cpu().numpy()
    position[::size, 3] = 0.0
    parts: list[np.ndarray | None] = [position]
    parts.append(None if groom.root_uv is None else groom.root_uv.cpu().numpy().astype("<f4"))
    if groom.width is None:
        parts.append(None)
    else:
        along = groom.width.cpu().double().numpy().reshape(-1, size)
        parts.append(along.mean(axis=1).astype("<f4"))
    if groom.color is None:
        parts.append(None)
    else:
        color = np.ones((len(groom.vertices), 4), dtype="<f4")
        color[:, :3] = np.repeat(groom.color.cpu().numpy(), size, axis=0)
        parts.append(color)
    offsets, end = [], HEADER.size
    for part in parts:
        offsets.append(0 if part is None else end)
        # Arrays start on multiples of eight bytes.
        end += 0 if part is None else -(-part.nbytes // 8) * 8
    at_position, at_uv, at_width, at_color = offsets
    with path.open("wb") as file:
        file.write(HEADER.pack(4.0, len(groom), size, at_position, at_uv, 0, at_width, at_color))
        for part in parts:
            if part is not None:
                file.write(part.tobytes() + b"\0" * (-part.nbytes % 8))
