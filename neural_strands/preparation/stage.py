"""Stages of a preparation: each has a folder, which is written atomically and reused while its inputs are the same.

A stage's inputs are a JSON document: its settings, and the digests of the files and stages that it reads. It is stored
beside the outputs, so that a later run knows whether they are still valid.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.files import atomic_folder

RECORD = "inputs.json"
"""Name of the file, in a stage's folder, that records its inputs."""
ADVICE = "remove its folder, and the stage is done again"
"""What to do about a damaged file of a stage."""


@dataclass(frozen=True)
class Stage:
    """A completed stage.

    Attributes:
        folder: folder of its outputs.
        digest: digest of everything that they were made from.
    """

    folder: Path
    digest: str

    def file(self, name: str) -> Path:
        """The path of one of the outputs.

        Raises:
            InputError: it is missing.
        """
        path = self.folder / name
        if not path.is_file():
            raise InputError(f"{path}: expected a file of this stage, found none; {ADVICE}.")
        return path


def run_stage(folder: Path, inputs: Mapping[str, Any], work: Callable[[Path], None]) -> tuple[Stage, bool]:
    """Run a stage, unless its outputs exist and were made from the same inputs.

    Args:
        folder: folder of the stage; replaced when the work is done.
        inputs: JSON values: settings, and digests of what the stage reads.
        work: writes the outputs into the folder that it receives.

    Returns:
        The stage, and whether it has run now.

    Raises:
        InputError: the folder cannot be written to. Whatever `work` raises is passed on.
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
        InputError: a file cannot be read.
    """
    total = hashlib.sha256()
    for path in paths:
        try:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256").digest()
        except OSError as error:
            raise InputError(
                f"{path}: expected a file, but it cannot be read ({reason(error)}); check the path."
            ) from error
        total.update(os.fsencode(path.name) + b"\0" + content)
    return total.hexdigest()


def _recorded(folder: Path) -> str | None:
    """The recorded inputs of the folder's outputs, if there are any."""
    try:
        return (folder / RECORD).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return None
