"""Local folders and folders in an object store: whole files are read and written, and tasks work on local copies.

A place is a local path, or a URL that fsspec understands, such as `s3://bucket/folder`.
"""

import re
import tempfile
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.files import LEFTOVER, LOCK, atomic_file, atomic_folder, sole_writer
from neural_strands.foundation.input_files import is_file_path, read_bytes

URL = re.compile(r"[a-z][a-z0-9+.-]+://.+")
UPLOAD_SECONDS = 300.0
"""Interval between uploads while a task works, seconds: at most this much work is lost with a node. Checkpoints are
large (docs/batch.md)."""
PATIENCE = 120.0
"""Time to wait until the process of a lost task, which may survive for a while, releases a folder, seconds."""
INPUTS = "inputs"
"""Name of the folder, in a subject's folder, for copies of remote inputs; never uploaded."""
LARGEST_RECORD = 2**24
"""Largest file that is read into memory, bytes."""


def is_remote(place: str) -> bool:
    """Whether a place is a URL."""
    return URL.fullmatch(place) is not None


@dataclass(frozen=True)
class Store:
    """A local folder, or one in an object store.

    Attributes:
        place: path or URL of the folder.
    """

    place: str

    @property
    def local(self) -> Path | None:
        """The folder's path, if it is local."""
        return None if is_remote(self.place) else Path(self.place)

    def child(self, name: str) -> "Store":
        """A folder inside this one."""
        return Store(f"{self.place.rstrip('/')}/{name}" if is_remote(self.place) else str(Path(self.place) / name))

    def read(self, name: str, what: str) -> bytes | None:
        """Read a file; None if it does not exist.

        Raises:
            InputError: the file cannot be read.
        """
        if self.local is not None:
            path = self.local / name
            return read_bytes(path, what, LARGEST_RECORD) if path.exists() else None
        with _remote(self.place) as (files, root):
            path = f"{root}/{name}"
            return files.cat_file(path) if files.exists(path) else None

    def write(self, name: str, content: bytes) -> None:
        """Write a file atomically.

        Raises:
            InputError: the file cannot be written.
        """
        if self.local is not None:
            with atomic_file(self.local / name) as temporary:
                temporary.write_bytes(content)
            return
        with _remote(self.place) as (files, root):
            files.pipe_file(f"{root}/{name}", content)

    def download(self, folder: Path, under: Sequence[str] = ("",), without: str | None = None) -> None:
        """Copy the files of a remote folder whose names begin with one of `under` and not with `without`.

        Raises:
            InputError: the store cannot be read, or names a file that would lie outside the folder.
        """
        with _remote(self.place) as (files, root):
            names = [path.removeprefix(root).lstrip("/") for path in files.find(root)]
            wanted = [
                name
                for name in names
                if name.startswith(tuple(under)) and not (without is not None and name.startswith(without))
            ]
            for name in wanted:
                if not is_file_path(name) or ".." in PurePosixPath(name).parts or "\\" in name:
                    raise InputError(f"{self.place}: expected file names inside it, found {name!r}; rename the file.")
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if wanted:
                files.get([f"{root}/{name}" for name in wanted], [str(folder / name) for name in wanted])

    def upload(self, folder: Path, names: Sequence[str]) -> None:
        """Copy files of a local folder into the remote one.

        Raises:
            InputError: the store cannot be written to.
        """
        if names:
            with _remote(self.place) as (files, root):
                files.put([str(folder / name) for name in names], [f"{root}/{name}" for name in names])

    def remove(self, names: Sequence[str]) -> None:
        """Remove files of a remote folder.

        Raises:
            InputError: the store cannot be written to.
        """
        if names:
            with _remote(self.place) as (files, root):
                files.rm([f"{root}/{name}" for name in names])


def fetched(place: str, target: Path) -> Path:
    """Local path of a place: the place itself, or a copy of a remote one, made once.

    Args:
        place: path or URL.
        target: path of the copy.

    Raises:
        InputError: the place does not exist or cannot be read.
    """
    if not is_remote(place):
        return Path(place)
    if target.exists():
        return target
    with _remote(place) as (files, root):
        if files.isfile(root):
            with atomic_file(target) as temporary:
                files.get_file(root, str(temporary))
            return target
    with atomic_folder(target) as temporary:
        Store(place).download(temporary)
        if not any(temporary.iterdir()):
            raise InputError(f"{place}: expected files, found nothing there; check the address.")
    return target


@contextmanager
def workspace(store: Store, fetch: Iterable[str], without: str | None) -> Iterator[Path]:
    """Yield the local folder in which a task works on `store`, locked against other tasks.

    A local folder is used in place. A remote one is copied; changes are uploaded every `UPLOAD_SECONDS` and at the end,
    however the task ends, so that another node can continue from there.

    Args:
        store: the folder.
        fetch: prefixes of the files that the task needs.
        without: prefix of files among them that it does not need.

    Raises:
        InputError: the folder cannot be read or written to, or another process keeps writing to it.
    """
    if store.local is not None:
        with sole_writer(store.local, PATIENCE):
            yield store.local
        return
    with tempfile.TemporaryDirectory(prefix="neural-strands-") as temporary:
        folder = Path(temporary) / PurePosixPath(store.place).name
        folder.mkdir()
        store.download(folder, tuple(fetch), without)
        with _Uploads(store, folder):
            yield folder


class _Uploads:
    """Synchronises a remote folder with its local copy."""

    def __init__(self, store: Store, folder: Path) -> None:
        self._store, self._folder = store, folder
        self._known = self._listed()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._keep, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._upload()

    def _keep(self) -> None:
        while not self._ended.wait(UPLOAD_SECONDS):
            # A store that does not answer now may do so at a later upload; the last one raises.
            try:
                self._upload()
            except InputError:
                continue

    def _upload(self) -> None:
        now = self._listed()
        changed = [name for name, state in now.items() if self._known.get(name) != state]
        # Upload in the order of writing, so that the remote folder is always a past state of the local one.
        self._store.upload(self._folder, sorted(changed, key=lambda name: now[name][1]))
        self._store.remove([name for name in self._known if name not in now])
        self._known = now

    def _listed(self) -> dict[str, tuple[int, int]]:
        """Size and modification time of every file, by name, except inputs, locks and unfinished files."""
        found = {}
        for path in self._folder.rglob("*"):
            parts = path.relative_to(self._folder).parts
            if parts[0] == INPUTS or any(part == LOCK or LEFTOVER.fullmatch(part) for part in parts):
                continue
            try:
                state = path.stat()
            except FileNotFoundError:
                continue
            if path.is_file():
                found["/".join(parts)] = (state.st_size, state.st_mtime_ns)
        return found


@contextmanager
def _remote(place: str) -> Iterator[tuple[Any, str]]:
    """The file system of a URL and the path in it; errors of the store become InputErrors."""
    try:
        import fsspec
    except ImportError as error:
        raise InputError(
            f"{place}: expected the package fsspec, found none; run: pip install neural-strands[batch]."
        ) from error
    try:
        files, root = fsspec.core.url_to_fs(place)
        # Cached listings do not show what other nodes have written.
        files.invalidate_cache()
        yield files, root.rstrip("/")
    except InputError:
        raise
    except Exception as error:
        # Every store raises its own errors, which have no other common class.
        raise InputError(
            f"{place}: expected a location that can be read and written, found none ({reason(error)}); check the "
            "address, the credentials, and that the store's package is installed."
        ) from error
