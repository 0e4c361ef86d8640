"""Files that are either whole or absent: write beside the target, then rename."""

import io
import json
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from neural_strands.foundation.errors import InputError, reason

LEFTOVER = re.compile(r"\..+\.[0-9a-f]{8}(?:\.old|\.[A-Za-z0-9]+)?")
"""Names of what `atomic_file` and `atomic_folder` write before they rename it."""
LOCK = ".in_use"
"""The file in a folder that whoever writes to it holds locked."""


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, renamed onto it when the block ends without an error.

    The suffix is kept, because many writers choose their format by it.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    temporary = path.with_name(f".{path.stem}.{uuid.uuid4().hex[:8]}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); nothing was changed.") from error
    finally:
        # Where the folder itself could not be made there is nothing to remove.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_json(path: Path, document: Any) -> None:
    """Write a JSON document.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(document, indent=1), encoding="utf-8")


def tensor_bytes(content: object) -> memoryview:
    """What `torch.save` writes, in memory: torch's own writer says RuntimeError, not OSError, when the disk is full."""
    import torch

    buffer = io.BytesIO()
    torch.save(content, buffer)
    return buffer.getbuffer()


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a temporary folder beside `path` that replaces it when the block ends without an error.

    Raises:
        InputError: the folder cannot be created or written to.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    retired = path.with_name(f"{temporary.name}.old")
    try:
        temporary.mkdir(parents=True)
        yield temporary
        if path.exists():
            path.replace(retired)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error}); nothing was changed.") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        shutil.rmtree(retired, ignore_errors=True)


@contextmanager
def sole_writer(folder: Path, patience: float = 0.0) -> Iterator[None]:
    """Let no other process write to a folder, and remove what one that was killed left unfinished in it.

    The system frees the lock when its process ends, however it ends.

    Args:
        folder: made if it is absent.
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
    except (OSError, NotImplementedError) as error:
        raise InputError(f"{folder}: cannot be written ({reason(error)}); nothing was changed.") from error
    try:
        remove_leftovers(folder)
        yield
    finally:
        # Windows removes no open file; one that stays does no harm, for it is the lock that counts.
        with suppress(OSError):
            (folder / LOCK).unlink()
        lock.release()
        with suppress(OSError):
            # Folders that nothing came of go again; others are not empty, and stay.
            for path in absent:
                path.rmdir()


def remove_leftovers(folder: Path) -> None:
    """Remove what `atomic_file` and `atomic_folder` had not finished in a folder when their process was killed.

    Only for whoever is the sole writer: what another process is writing looks the same.
    """
    for path in folder.iterdir():
        if LEFTOVER.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
