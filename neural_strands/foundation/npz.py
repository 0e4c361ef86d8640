"""Reads arrays from untrusted .npz files.

The archive's directory and each array's own header are read first. Their claims are checked against each other, against
the size of the file and against what the caller expects, before memory is allocated for an array. Nothing is unpickled.
"""

import io
import math
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import InputError, excerpt, reason
from neural_strands.foundation.input_files import check_file

LARGEST_ARCHIVE = 2**32
"""Default limit on all arrays of an archive, bytes, unpacked."""
MOST_INFLATED = 100
"""An archive may not claim to unpack to more than this many times its own size, plus `SLACK`."""
SLACK = 2**20
"""Size that any archive may unpack to, bytes."""
PIECE = 2**22
"""Number of bytes unpacked at once."""
LARGEST_HEADER = 2**14
"""Largest header of an array, bytes; more than that of any plain array."""
KINDS = {"f": "floats", "i": "whole numbers", "u": "unsigned numbers", "b": "booleans"}
"""Meaning of numpy's letters for kinds of numbers."""


@dataclass(frozen=True)
class ArraySpec:
    """Specification of an array in an archive.

    Attributes:
        name: its name in the archive.
        shape: names or sizes of its axes, separated by spaces, as jaxtyping writes them: "point 3". Axes of the same
            name have the same size in all arrays of an archive, and "point+1" is one more than "point"; "" is a single
            number, and None takes any shape.
        dtype: type of the returned array; None keeps the stored type, in this machine's byte order.
        kinds: numpy's letters of the accepted kinds of numbers: f float, i and u integers, b booleans.
        required: whether an archive without it is refused.
        finite: whether NaN and infinity are refused.
    """

    name: str
    shape: str | None
    dtype: type[np.generic] | None = None
    kinds: str = "f"
    required: bool = True
    finite: bool = True


@dataclass(frozen=True)
class _Member:
    """An array of an archive, as described by its headers."""

    info: zipfile.ZipInfo
    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype
    start: int


def read_npz(
    path: Path, what: str, specs: Sequence[ArraySpec], advice: str = "export it again", most: int = LARGEST_ARCHIVE
) -> dict[str, np.ndarray]:
    """Read the specified arrays; others in the archive are ignored.

    Args:
        path: the archive.
        what: expected content, for error messages, such as "line segments".
        specs: the arrays to read.
        advice: what to do where it holds something else.
        most: limit on all arrays together, bytes.

    Returns:
        Writable arrays by name; an array that is not required may be absent.

    Raises:
        InputError: the file cannot be read, is not an archive of plain arrays, or an array does not match `specs`.
    """
    check_file(path, what)
    with _Archive(path, what, advice) as archive:
        infos = _chosen(archive, specs, most)
        members: dict[str, _Member] = {}
        sizes: dict[str, int] = {}
        for spec in specs:
            if spec.name in infos:
                members[spec.name] = _described(archive, infos[spec.name])
                _check_shape(archive, members[spec.name], spec, sizes)
        return {spec.name: _array(archive, members[spec.name], spec) for spec in specs if spec.name in infos}


def array_names(path: Path) -> set[str]:
    """Names of the arrays in an .npz file; empty for any other or a damaged file."""
    if path.suffix.lower() != ".npz":
        return set()
    try:
        with _Archive(path, "arrays", "export it again") as archive:
            return {_name(info) for info in archive.zip.infolist()}
    except InputError:
        # The next reader of the file reports what is wrong with it.
        return set()


class _Archive:
    """An open archive, and the errors about it."""

    zip: zipfile.ZipFile

    def __init__(self, path: Path, what: str, advice: str) -> None:
        self.path, self.what, self.advice = path, what, advice

    def __enter__(self) -> "_Archive":
        with self.guarded(0):
            self.zip = zipfile.ZipFile(self.path)
        return self

    def __exit__(self, *_: object) -> None:
        self.zip.close()

    def refuse(self, place: int, expected: str, found: str) -> InputError:
        """Build the error about a byte of the file."""
        return InputError(f"{self.path}: byte {place}: expected {expected}, found {found}; {self.advice}.")

    @contextmanager
    def guarded(self, place: int) -> Iterator[None]:
        """Turn any failure of zipfile, zlib or numpy's header parser into an InputError.

        They raise a dozen kinds of errors, from BadZipFile to TokenError. Only their calls belong in the block, so that
        no bug of ours is reported as a damaged file.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                yield
        except Exception as error:
            found = f"a broken one ({reason(error)})"
            raise self.refuse(place, f"{self.what} (an .npz archive of plain arrays)", found) from error


def _name(info: zipfile.ZipInfo) -> str:
    return info.filename.removesuffix(".npy")


def _chosen(archive: _Archive, specs: Sequence[ArraySpec], most: int) -> dict[str, zipfile.ZipInfo]:
    """The directory's entries of the specified arrays, after checking their claimed sizes against the file's."""
    chosen: dict[str, zipfile.ZipInfo] = {}
    wanted = {spec.name for spec in specs}
    entries = archive.zip.infolist()
    for info in entries:
        if _name(info) in chosen:
            raise archive.refuse(info.header_offset, "every array once", f"{excerpt(_name(info))} twice")
        if _name(info) in wanted:
            chosen[_name(info)] = info
    for spec in specs:
        if spec.required and spec.name not in chosen:
            found = excerpt(", ".join(_name(info) for info in entries[:10])) if entries else "none"
            raise archive.refuse(0, f"an array {spec.name}", found)
    claimed, size = sum(info.file_size for info in chosen.values()), archive.path.stat().st_size
    if claimed > min(most, MOST_INFLATED * size + SLACK):
        raise archive.refuse(0, "arrays of a sane size", f"{claimed} bytes claimed by a file of {size}")
    return chosen


def _described(archive: _Archive, info: zipfile.ZipInfo) -> _Member:
    """Read an array's own header and check it against the archive's directory."""
    name, place = excerpt(_name(info)), info.header_offset
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise archive.refuse(place, f"{name} stored or deflated", f"compression {info.compress_type}")
    with archive.guarded(place):
        with archive.zip.open(info) as file:
            head = io.BytesIO(file.read(LARGEST_HEADER))
        version = np.lib.format.read_magic(head)
        first = version == (1, 0)
        read_header = np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read_header(head)
    if version not in ((1, 0), (2, 0)):
        raise archive.refuse(place, "an array of .npy version 1 or 2", f"version {version[0]}.{version[1]}")
    if dtype.hasobject or dtype.kind not in KINDS:
        raise archive.refuse(place, f"{name} of plain numbers", excerpt(str(dtype)))
    claimed = head.tell() + math.prod(shape) * dtype.itemsize
    if claimed != info.file_size or any(side < 0 for side in shape):
        expected = f"{name} of as many bytes as its shape says ({excerpt(claimed)})"
        raise archive.refuse(place, expected, f"{info.file_size}")
    return _Member(info, tuple(shape), fortran, dtype, head.tell())


def _check_shape(archive: _Archive, member: _Member, spec: ArraySpec, sizes: dict[str, int]) -> None:
    """Check kind and shape against the specification; `sizes` collects the sizes of named axes."""
    axes = None if spec.shape is None else spec.shape.split()
    fits = axes is None or len(axes) == len(member.shape)
    for axis, side in zip(axes or (), member.shape, strict=False):
        name, _, more = axis.partition("+")
        size = side - int(more or 0)
        fits = fits and size == (int(name) if name.isdigit() else sizes.setdefault(name, size))
    if not fits or member.dtype.kind not in spec.kinds:
        kinds = " or ".join(KINDS[kind] for kind in spec.kinds)
        sides = [f"{axis} = {sizes[axis]}" if axis in sizes else axis for axis in axes or ()]
        shape = "any shape" if axes is None else f"shape ({', '.join(sides)})"
        found = excerpt(f"{member.dtype} {member.shape}")
        raise archive.refuse(member.info.header_offset, f"{spec.name} of {kinds} in {shape}", found)


def _array(archive: _Archive, member: _Member, spec: ArraySpec) -> np.ndarray:
    """Read an array, and convert and check its numbers."""
    place = member.info.header_offset
    stored = _stored(archive, member)
    wanted = member.dtype.newbyteorder("=") if spec.dtype is None else np.dtype(spec.dtype)
    if wanted.kind in "iu" and stored.size:
        bounds, low, high = np.iinfo(wanted.name), int(stored.min()), int(stored.max())
        if low < bounds.min or high > bounds.max:
            raise archive.refuse(place, f"{spec.name} within {wanted}", f"{low} to {high}")
    with np.errstate(over="ignore", invalid="ignore"):
        array = stored.astype(wanted, copy=False).reshape(member.shape, order="F" if member.fortran else "C")
    if spec.finite and array.dtype.kind == "f" and not np.isfinite(array).all():
        first = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        found = f"{array[first]} at [{', '.join(str(index) for index in first)}]"
        raise archive.refuse(place, f"finite numbers in {spec.name}", found)
    return np.asarray(array, order="C")


def _stored(archive: _Archive, member: _Member) -> np.ndarray:
    """The numbers of an array in file order; zipfile compares the checksum with the last of them."""
    stored = np.zeros(math.prod(member.shape), member.dtype)
    target, done = stored.view(np.uint8), 0
    with archive.guarded(member.info.header_offset), archive.zip.open(member.info) as file:
        file.read(member.start)
        while done < len(target):
            piece = file.read(min(PIECE, len(target) - done))
            if not piece:
                raise EOFError(f"it ends {len(target) - done} bytes early")
            target[done : done + len(piece)] = np.frombuffer(piece, np.uint8)
            done += len(piece)
    return stored
