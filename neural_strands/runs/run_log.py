"""The log of a run: the figures of every step."""

import json
from pathlib import Path

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file


class RunLog:
    """Figures of every step, one JSON object per line; lines after the step from which a run resumes are dropped."""

    def __init__(self, path: Path, step: int) -> None:
        """Open the log of a run that has done `step` steps.

        Raises:
            InputError: the file cannot be written.
        """
        self._path = path
        kept = path.read_text(encoding="utf-8").splitlines()[:step] if path.is_file() and step else []
        with atomic_file(path) as temporary:
            temporary.write_text("".join(line + "\n" for line in kept), encoding="utf-8")
        self._waiting: list[str] = []

    def add(self, figures: dict[str, float]) -> None:
        """Append one step; `flush` writes it to disk."""
        self._waiting.append(json.dumps({name: round(value, 6) for name, value in figures.items()}) + "\n")

    def flush(self) -> None:
        """Write the added steps to disk.

        Raises:
            InputError: the disk is full or cannot be written to.
        """
        lines, self._waiting = self._waiting, []
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.writelines(lines)
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written ({error.strerror or error}).") from error
