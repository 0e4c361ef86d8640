"""Reads whole files as bytes or text; every failure is an InputError."""

import stat
import unicodedata
from pathlib import Path, PurePosixPath

from neural_strands.foundation.errors import InputError, reason

LARGEST_FILE = 2**32
"""Default size of the largest file that is read at once, bytes."""
LONGEST_PATH = 1000
"""Longest path that a file may name, characters; operating systems accept about 4000 bytes."""
REFUSED_LETTERS = {"Cc", "Cs", "Zl", "Zp"}
"""Unicode categories of control characters, surrogates and line separators."""
LONGEST_NAME = 240
"""Longest name of a file or folder, bytes; operating systems accept 255, and names of masks are longer than those of
images."""


def read_bytes(path: Path, what: str, most: int = LARGEST_FILE) -> bytes:
    """Read a whole file.

    Args:
        path: the file.
        what: expected content, for the error message, such as "a groom".
        most: largest accepted file, bytes; a larger one is refused before anything is allocated.

    Raises:
        InputError: the file does not exist, is not a regular file, is too large, or cannot be read.
    """
    check_file(path, what, most)
    try:
        return path.read_bytes()
    except (OSError, MemoryError) as error:
        raise InputError(f"{path}: expected {what}, but it cannot be read ({reason(error)}).") from error


def read_text(path: Path, what: str, most: int = LARGEST_FILE) -> str:
    """Read a whole file of UTF-8, without its byte order mark, if it has one.

    Raises:
        InputError: as for `read_bytes`, or the file is not UTF-8.
    """
    try:
        return read_bytes(path, what, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: expected {what} as UTF-8 text, found byte {error.object[error.start]:#04x} at {error.start}; "
            "save it as UTF-8."
        ) from error


def is_file_path(text: str) -> bool:
    """Whether a text can be the path of a file: without control characters, and not too long for operating systems."""
    path = PurePosixPath(text)
    short = len(text) <= LONGEST_PATH and all(len(part.encode(errors="replace")) <= LONGEST_NAME for part in path.parts)
    return bool(path.name) and path.name != ".." and short and not has_controls(text)


def is_file_name(text: str) -> bool:
    """Whether a text can be the name of a file in a folder, and leads to no other folder."""
    return is_file_path(text) and Path(text).name == text


def has_controls(text: str) -> bool:
    """Whether a text contains characters that no name may have: control characters, surrogates, line separators."""
    return not text.isprintable() and any(unicodedata.category(letter) in REFUSED_LETTERS for letter in text)


def check_file(path: Path, what: str, most: int = LARGEST_FILE) -> None:
    """Refuse files that `read_bytes` would refuse, for readers that open the file themselves.

    Raises:
        InputError: the file does not exist, is not a regular file, or is too large.
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
