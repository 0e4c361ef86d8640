"""Stages of a preparation: each has a folder, written whole or not at all, and skipped while its inputs are the same.

A stage's inputs are a JSON document: its settings, and the digests of the files and of the stages that it reads. They
lie beside its outputs, so that a later run knows whether these still hold.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neural_strands.foundation.files import atomic_folder

RECORD = "inputs.json"
"""What a stage was made from, in its folder."""


@dataclass(frozen=True)
class Stage:
    """A stage that is done.

    Attributes:
        folder: its outputs.
        digest: of everything that they were made from.
    """

    folder: Path
    digest: str


def run_stage(folder: Path, inputs: Mapping[str, Any], work: Callable[[Path], None]) -> tuple[Stage, bool]:
    """Do a stage's work, unless its outputs are there and were made from the same inputs.

    Args:
        folder: of the stage; replaced when the work is done.
        inputs: JSON: settings, and digests of what the stage reads.
        work: writes the outputs into the folder it is given.

    Returns:
        The stage, and whether it was worked on now.

    Raises:
        InputError: the folder cannot be written to, or whatever `work` raises.
    """
    text = json.dumps(inputs, sort_keys=True, indent=1)
    stage = Stage(folder, hashlib.sha256(text.encode()).hexdigest())
    if _recorded(folder) == text:
        return stage, False
    with atomic_folder(folder) as temporary:
        work(temporary)
        (temporary / RECORD).write_text(text, encoding="utf-8")
    return stage, True


def digest_files(paths: Iterable[Path]) -> str:
    """SHA-256 over the names and contents of files, in this order.

    Raises:
        OSError: a file cannot be read.
    """
    total = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            total.update(path.name.encode() + b"\0" + hashlib.file_digest(file, "sha256").digest())
    return total.hexdigest()


def _recorded(folder: Path) -> str | None:
    """The inputs that the folder's outputs were made from, if it holds any."""
    try:
        return (folder / RECORD).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
