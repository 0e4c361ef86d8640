"""Reading and writing grooms, by the suffix of the file."""

from collections.abc import Callable
from pathlib import Path

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.grooms.checks import check_writable
from neural_strands.grooms.data import read_data, write_data
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.hair import read_hair, write_hair
from neural_strands.grooms.npz import read_groom_npz, write_groom_npz
from neural_strands.grooms.obj import read_obj, write_obj
from neural_strands.grooms.ply import read_ply, write_ply
from neural_strands.grooms.tfx import read_tfx, write_tfx
from neural_strands.grooms.tfx_text import is_tfx_text, read_tfx_text, write_tfx_text
from neural_strands.grooms.usd import read_usd, write_usd


def _read_either_tfx(path: Path) -> Groom:
    return read_tfx_text(path) if is_tfx_text(path) else read_tfx(path)


def _write_either_tfx(path: Path, groom: Groom) -> None:
    """Write version 4 if all strands have the same number of points, otherwise version 2, which allows any."""
    (write_tfx_text if groom.uniform_size is None else write_tfx)(path, groom)


READERS: dict[str, Callable[[Path], Groom]] = {
    ".hair": read_hair,
    ".data": read_data,
    ".tfx": _read_either_tfx,
    ".usd": read_usd,
    ".usda": read_usd,
    ".usdc": read_usd,
    ".ply": read_ply,
    ".obj": read_obj,
    ".npz": read_groom_npz,
}
"""Reader by suffix."""
WRITERS: dict[str, Callable[[Path, Groom], None]] = {
    ".hair": write_hair,
    ".data": write_data,
    ".tfx": _write_either_tfx,
    ".usd": write_usd,
    ".usda": write_usd,
    ".usdc": write_usd,
    ".ply": write_ply,
    ".obj": write_obj,
    ".npz": write_groom_npz,
}
"""Writer by suffix."""


def read_groom(path: Path | str) -> Groom:
    """Read a groom, in the unit and axes of its file (USD: converted to metres, y up).

    Raises:
        InputError: the suffix is unknown, or the file is damaged or of another kind.

    Examples:
        >>> import neural_strands as ns
        >>> groom = ns.read_groom("run/groom.npz")
        >>> len(groom), groom.sizes.unique()
        (200, tensor([24]))
    """
    path = Path(path)
    if not path.is_file():
        found = "a folder there; name a file in it" if path.is_dir() else "nothing there; check the path"
        raise InputError(f"{path}: expected a groom file, found {found}.")
    return READERS[_suffix(path)](path)


def write_groom(path: Path | str, groom: Groom) -> None:
    """Write a groom atomically; the module of each format says which attributes it stores.

    Raises:
        InputError: the suffix is unknown, the groom has values that no reader accepts, or the file cannot be written.
    """
    path = Path(path)
    writer = WRITERS[_suffix(path)]
    check_writable(path, groom)
    with atomic_file(path) as temporary:
        writer(temporary, groom)


def check_suffix(path: Path | str) -> None:
    """Reject a name whose suffix no writer supports, before any work is done.

    Raises:
        InputError: the suffix is not supported; the message lists those that are.
    """
    _suffix(Path(path))


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(
            f"{path}: expected a groom with one of {', '.join(READERS)}, found {suffix or 'no suffix'}; choose one."
        )
    return suffix
