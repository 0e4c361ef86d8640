"""`.npz` archives of numpy: arrays named as the fields of `Groom`; everything is kept exactly (float32, int64).

An archive may also hold `points` (strand, point, 3) in place of `vertices` and `offsets`.
"""

import io
import math
import zipfile
import zlib
from pathlib import Path

import numpy as np

from neural_strands.grooms.checks import build_groom, read_bytes, refuse
from neural_strands.grooms.groom import ATTRIBUTES, Groom

MOST_INFLATED = 100
"""A compressed array may not claim to be more than this many times its stored size (plus a megabyte)."""
HEADER_BYTES = 4096
"""More than any header of a plain array takes."""


def read_npz(path: Path) -> Groom:
    """Read an `.npz` archive.

    Raises:
        InputError: it is no archive, lacks arrays, or they claim more than is there.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(path))) as archive:
            arrays = {info.filename.removesuffix(".npy"): _array(path, archive, info) for info in archive.infolist()}
            places = {info.filename.removesuffix(".npy"): info.header_offset for info in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, RuntimeError, EOFError, ValueError, OSError) as error:
        raise refuse(path, "byte 0", "an .npz archive of plain arrays", f"a broken one ({error})") from error
    if "points" in arrays and "vertices" not in arrays:
        points = arrays.pop("points")
        if points.ndim != 3 or points.shape[2] != 3:
            raise refuse(path, f"byte {places['points']}", "points (strand, point, 3)", f"{points.shape}")
        arrays["vertices"] = points.reshape(-1, 3)
        arrays["offsets"] = np.arange(len(points) + 1) * points.shape[1]
        places |= {"vertices": places["points"], "offsets": places["points"]}
    for name in ("vertices", "offsets"):
        if name not in arrays:
            raise refuse(path, "byte 0", f"an array {name}", f"{', '.join(arrays) or 'nothing'}", "choose a groom")
    sizes = _sizes(path, arrays, places["offsets"])
    vertices = arrays["vertices"]
    shapes = {"vertices": (len(vertices), 3), "root_uv": (len(sizes), 2), "root_normal": (len(sizes), 3)}
    shapes |= {"width": (len(vertices),), "color": (len(sizes), 3), "unseen": (len(sizes),)}
    for name, shape in shapes.items():
        if name in arrays and (arrays[name].shape != shape or arrays[name].dtype.kind != "f"):
            found = f"{arrays[name].dtype} {arrays[name].shape}"
            raise refuse(path, f"byte {places[name]}", f"{name} of floats {shape}", found)

    def locate(name: str, row: int) -> str:
        """The archive's entry; an entry may be compressed, so the row is named as well."""
        return f"byte {places[name]} (array {name}, row {row})"

    return build_groom(path, vertices, sizes, locate, {name: arrays.get(name) for name in ATTRIBUTES})


def write_npz(path: Path, groom: Groom) -> None:
    """Write an `.npz` archive, uncompressed."""
    fields = {name: getattr(groom, name) for name in ("vertices", "offsets", *ATTRIBUTES)}
    arrays = {name: value.cpu().numpy() for name, value in fields.items() if value is not None}
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def _array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """Read one array after its claims about its size are held against what is stored."""
    where = f"byte {info.header_offset}"
    if info.file_size > MOST_INFLATED * info.compress_size + 2**20:
        raise refuse(path, where, f"{info.filename} of a sane size", f"{info.file_size} bytes claimed")
    with archive.open(info) as file:
        head = io.BytesIO(file.read(HEADER_BYTES))
    version = np.lib.format.read_magic(head)
    read_header = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read_header is None:
        raise refuse(path, where, "an array of .npy version 1 or 2", f"version {version[0]}")
    shape, fortran, dtype = read_header(head)
    if dtype.hasobject or dtype.kind not in "fiu":
        raise refuse(path, where, f"{info.filename} of plain numbers", f"{dtype}")
    claimed = head.tell() + math.prod(shape) * dtype.itemsize
    if claimed != info.file_size:
        raise refuse(path, where, f"{info.filename} of {claimed} bytes as its shape says", f"{info.file_size}")
    body = archive.read(info)[head.tell() :]
    return np.frombuffer(body, dtype).reshape(shape, order="F" if fortran else "C")


def _sizes(path: Path, arrays: dict[str, np.ndarray], place: int) -> np.ndarray:
    """Points of each strand."""
    offsets, total = arrays["offsets"], len(arrays["vertices"]) if arrays["vertices"].ndim else 0
    good = offsets.ndim == 1 and offsets.dtype.kind in "iu" and len(offsets) > 0
    if not good or offsets[0] != 0 or offsets[-1] != total or (offsets[1:] < offsets[:-1]).any():
        expected = f"offsets that rise from 0 to {total} vertices"
        raise refuse(path, f"byte {place}", expected, f"{offsets.dtype} {offsets.shape}")
    return np.diff(offsets.astype(np.int64))
