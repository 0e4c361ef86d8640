"""Whole files as bytes or text; whatever keeps a file from being read is one sentence."""

import stat
import unicodedata
from pathlib import Path, PurePosixPath

from neural_strands.foundation.errors import InputError, reason

LARGEST_FILE = 2**32
"""Bytes of the largest file that is read at once, unless the caller allows less."""
LONGEST_PATH = 1000
"""Letters of a path that a file may name; systems take some 4000 bytes."""
REFUSED_LETTERS = {"Cc", "Cs", "Zl", "Zp"}
"""Unicode categories of control characters, halves of a letter and line separators."""
LONGEST_NAME = 240
"""Bytes of a file's or folder's name: systems take 255, and names of masks are longer than those of images."""


def read_bytes(path: Path, what: str, most: int = LARGEST_FILE) -> bytes:
    """Read a whole file.

    Args:
        path: the file.
        what: what it should hold, for the message: "a groom".
        most: bytes of the largest file that is read; a larger one is refused before anything is allocated.

    Raises:
        InputError: there is no such file, it is no regular file, it is too large, or it cannot be read.
    """
    check_file(path, what, most)
    try:
        return path.read_bytes()
    except (OSError, MemoryError) as error:
        raise InputError(f"{path}: expected {what}, but it cannot be read ({reason(error)}).") from error


def read_text(path: Path, what: str, most: int = LARGEST_FILE) -> str:
    """Read a whole file of UTF-8; a byte order mark at its start is left out.

    Raises:
        InputError: as `read_bytes`, or the file holds other bytes than UTF-8.
    """
    try:
        return read_bytes(path, what, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected {what} as UTF-8 text, found byte {error.object[error.start]:#04x} at {error.start}; "
            "save it as UTF-8."
        ) from error


def is_file_path(text: str) -> bool:
    """Whether a text from a file can name a file: without control characters, of lengths that systems take."""
    path = PurePosixPath(text)
    short = len(text) <= LONGEST_PATH and all(len(part.encode(errors="replace")) <= LONGEST_NAME for part in path.parts)
    return bool(path.name) and path.name != ".." and short and not has_controls(text)


def has_controls(text: str) -> bool:
    """Whether a text holds what no name or path may: control characters, halves of a letter, line separators."""
    return not text.isprintable() and any(unicodedata.category(letter) in REFUSED_LETTERS for letter in text)


def check_file(path: Path, what: str, most: int = LARGEST_FILE) -> None:
    """Refuse what `read_bytes` would refuse, for readers that open the file themselves.

    Raises:
        InputError: there is no such file, it is no regular file, or it is too large.
    """
    try:
        status = path.stat()
    except FileNotFoundError as error:
        raise InputError(f"{path}: expected {what}, found nothing there; check the path.") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected {what}, but it cannot be read ({reason(error)}).") from error
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a device or pipe"
        raise InputError(f"{path}: expected {what}, found {kind}; name a file.")
    if status.st_size > most:
        raise InputError(f"{path}: expected {what} of at most {most} bytes, found {status.st_size}; name another file.")
