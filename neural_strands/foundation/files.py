"""Atomic writes: files and folders are written beside their target, then renamed."""

import io
import json
import os
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from neural_strands.foundation.errors import InputError, reason

LEFTOVER = re.compile(r"\..+\.[0-9a-f]{8}(?:\.old|\.[A-Za-z0-9]+)?")
"""Names of temporary files and folders of `atomic_file` and `atomic_folder`."""
SET_ASIDE = re.compile(r"\.(.+)\.[0-9a-f]{8}\.old")
"""Names of folders that `atomic_folder` is replacing."""
LOCK = ".in_use"
"""Name of the lock file in a folder that is being written to."""
LEFT_BY_SYSTEMS = (".DS_Store", "desktop.ini", "Thumbs.db")
"""Files that systems leave in folders that a user has looked at."""


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, renamed onto it when the block ends without an error.

    The temporary path has the same suffix, because many writers choose their format by it. If `path` is a symbolic
    link, the link stays, and the file that it leads to is replaced.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    target = _without_links(path)
    temporary = _beside(target, path.suffix)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(target)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        # If the folder could not be created, there is nothing to remove.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def check_writable(path: Path) -> None:
    """Refuse a file that cannot be written, before the work whose result it would hold.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    target = _without_links(path)
    probe = _beside(target, path.suffix)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise _unwritable(path, error) from error


def check_folder_writable(folder: Path) -> None:
    """Refuse a folder that cannot be created or written to, before the work whose results it would hold.

    The folder is not created.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    try:
        there = next(path for path in (folder, *folder.parents) if path.exists())
        probe = _beside(there / folder.name, "")
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise _unwritable(folder, error) from error


def is_taken(folder: Path) -> bool:
    """Whether something that a user may want to keep is where a folder is to be written: a file, or a full folder."""
    if not folder.is_dir():
        return folder.exists()
    return any(path.name not in LEFT_BY_SYSTEMS for path in folder.iterdir())


def _without_links(path: Path) -> Path:
    """Where a file is that is written to under this name: elsewhere if the name is a symbolic link."""
    # `Path.resolve` raises another error in each version of Python if a link leads to itself.
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def _beside(target: Path, suffix: str) -> Path:
    return target.with_name(f".{target.stem}.{uuid.uuid4().hex[:8]}{suffix}")


def _unwritable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: cannot be written ({reason(error)}); nothing was changed.")


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1), encoding="utf-8")


def tensor_bytes(content: object) -> memoryview:
    """Run `torch.save` in memory: its file writer raises RuntimeError, not OSError, if the disk is full."""
    import torch

    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getbuffer()


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path` that replaces it when the block ends without an error.

    The old folder is set aside for a moment, because a rename does not replace a folder that has contents. If this
    process is killed then, the next writer puts the old folder back. If `path` is a symbolic link, the folder that it
    leads to is replaced.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    target = _without_links(path)
    temporary = target.with_name(f".{target.name}.{uuid.uuid4().hex[:8]}")
    retired = target.with_name(f"{temporary.name}.old")
    try:
        temporary.mkdir(parents=True)
        _put_back(target.parent, target.name)
        yield temporary
        if target.exists():
            target.replace(retired)
        temporary.replace(target)
    except OSError as error:
        raise _unwritable(path, error) from error
    finally:
        with suppress(OSError):
            if retired.exists() and not target.exists():
                retired.rename(target)
        if target.exists():
            shutil.rmtree(retired, ignore_errors=True)
        shutil.rmtree(temporary, ignore_errors=True)


@contextmanager
def sole_writer(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Lock a folder against other writers, and remove unfinished files of killed processes.

    The operating system releases the lock when the process ends, however it ends.

    Args:
        folder: the folder; created if it does not exist.
        patience: seconds to wait for another process to end.

    Raises:
        InputError: another process writes to the folder, or the folder cannot be written to.
    """
    import filelock

    lock = filelock.FileLock(folder / LOCK, timeout=patience)
    absent = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except filelock.Timeout as error:
        raise InputError(
            f"{folder}: expected a folder that no other process writes to, found one that does; wait until it has "
            "ended, or name another folder."
        ) from error
    except (OSError, NotImplementedError) as error:  # filelock's answer to a file system that cannot lock files
        raise _unwritable(folder, error) from error
    try:
        remove_leftovers(folder)
        yield
    finally:
        # Windows cannot remove an open file. A remaining file does no harm, because only the lock on it counts.
        with suppress(OSError):
            (folder / LOCK).unlink()
        lock.release()
        with suppress(OSError):
            # Remove folders that were created but stayed empty.
            for path in absent:
                path.rmdir()


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of `atomic_file` and `atomic_folder` whose process was killed.

    A folder that was set aside and has not been replaced is put back. Only for the sole writer of a folder: files
    that another process is writing look the same.
    """
    _put_back(folder)
    for path in folder.iterdir():
        if LEFTOVER.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def _put_back(folder: Path, name: str | None = None) -> None:
    """Rename folders that `atomic_folder` has set aside back to what they were, unless they have been replaced.

    Args:
        folder: where to look.
        name: of the only folder to put back; None for all.
    """
    with suppress(OSError):
        found = [(path, match[1]) for path in folder.iterdir() if (match := SET_ASIDE.fullmatch(path.name))]
        # Of several that were set aside under one name, the one that was written last.
        for path, wanted in sorted(found, key=lambda pair: -pair[0].stat().st_mtime_ns):
            if path.is_dir() and name in (None, wanted) and not (folder / wanted).exists():
                path.rename(folder / wanted)
