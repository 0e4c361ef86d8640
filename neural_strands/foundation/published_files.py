"""Files that others have published, such as weights of networks: in a folder, in the user's cache, or fetched once.

A file that is fetched is kept only if its sha256 is the published one.
"""

import contextlib
import hashlib
import http.client
import math
import os
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file

FOLDER_VARIABLE = "NEURAL_STRANDS_WEIGHTS"
"""Environment variable that names a folder of such files."""
TIMEOUT = 10.0
"""Time without an answer after which an address counts as unreachable, seconds. A name may have several."""
PAUSE = 3600.0
"""Time for which a file that could not be fetched, and that one can do without, is not tried again, seconds."""
LARGEST_DOWNLOAD = 2**30
"""Largest download, bytes."""


@dataclass(frozen=True)
class PublishedFile:
    """One published file.

    Attributes:
        names: names it may have in a folder; the first is the one it gets in the cache.
        address: where it is published.
        sha256: the digest in hexadecimal, or its first eight digits.
        option: the option of the command line that names such a file, if there is one.
    """

    names: tuple[str, ...]
    address: str
    sha256: str
    option: str = ""


def cache_folder() -> Path:
    """The folder for fetched files, in the user's cache."""
    root = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return (Path(root) if root else Path.home() / ".cache") / "neural-strands"


def find_file(file: PublishedFile, fetch: bool = True, is_required: bool = True) -> Path:
    """The path of a file: in the folder of NEURAL_STRANDS_WEIGHTS, in the cache, or fetched into the cache.

    Args:
        file: which file.
        fetch: whether it may be fetched.
        is_required: whether it is tried again at once if it could not be fetched before. Otherwise a failure is
            remembered in the cache for `PAUSE`: behind a firewall, each attempt may take minutes.

    Raises:
        InputError: it is not found, and its address does not answer or returns something else.
    """
    named = os.environ.get(FOLDER_VARIABLE)
    folders = [Path(named)] if named else []
    for folder in [*folders, cache_folder()]:
        for name in file.names:
            if (folder / name).is_file():
                return folder / name
    remedy = f"set {FOLDER_VARIABLE} to a folder that holds it"
    if file.option:
        remedy = f"name it with {file.option}, or {remedy}"
    if not fetch:
        raise InputError(f"{file.names[0]}: expected it in a folder of weights, found it in none; {remedy}.")
    target = cache_folder() / file.names[0]
    failure = target.with_name(f"{target.name}.failed")
    if not is_required and _seconds_since(failure) < PAUSE:
        raise InputError(
            f"{file.names[0]}: not found, and {file.address} could not be fetched within the last hour; "
            f"{remedy}, or delete {failure} to try again now."
        )
    try:
        content = _fetched(file, remedy)
    except InputError:
        if not is_required:
            # A cache that cannot be written to only costs time.
            with contextlib.suppress(InputError), atomic_file(failure) as temporary:
                temporary.touch()
        raise
    with atomic_file(target) as temporary:
        temporary.write_bytes(content)
    failure.unlink(missing_ok=True)
    return target


def _seconds_since(written: Path) -> float:
    """Age of a file; infinite if there is none, or if the clock was ahead when it was written."""
    try:
        age = time.time() - written.stat().st_mtime
    except OSError:
        return math.inf
    return age if age >= 0 else math.inf


def _fetched(file: PublishedFile, remedy: str) -> bytes:
    """The file's contents from its address.

    Raises:
        InputError: the address does not answer or returns something else.
    """
    try:
        with urllib.request.urlopen(file.address, timeout=TIMEOUT) as answer:
            content = answer.read(LARGEST_DOWNLOAD)
    except (urllib.error.URLError, http.client.HTTPException, OSError, ValueError) as error:
        if isinstance(error, urllib.error.HTTPError):
            # It holds the open answer.
            error.close()
        raise InputError(
            f"{file.names[0]}: not found, and {file.address} cannot be reached ({error}); {remedy}."
        ) from error
    digest = hashlib.sha256(content).hexdigest()
    if not digest.startswith(file.sha256):
        raise InputError(f"{file.address}: expected a file with sha256 {file.sha256}, found {digest}; {remedy}.")
    return content
