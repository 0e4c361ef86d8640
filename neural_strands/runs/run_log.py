"""The log of a run: the figures of every step."""

import json
import logging
import math
from contextlib import suppress
from pathlib import Path

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file
from neural_strands.foundation.input_files import read_bytes
from neural_strands.foundation.json_files import parse_json

log = logging.getLogger(__name__)

LOSSES = {
    "surface": "distance, strands to segments",
    "coverage": "distance, segments to strands",
    "streaks": "angle between strands and streaks",
    "head": "depth inside the head",
    "first": "distance of seen points from the first strands",
    "hidden": "distance of hidden points from the first strands",
    "render": "colour error",
    "perceptual": "perceptual colour error",
    "alpha": "opacity error",
}
"""What the losses of a fit measure, for people, by their names in the log."""


class RunLog:
    """Figures of every step, one JSON object per line; lines after the step from which a run resumes are dropped."""

    def __init__(self, path: Path, step: int) -> None:
        """Open the log of a run that has done `step` steps.

        Raises:
            InputError: the file cannot be written.
        """
        self._path = path
        kept = _lines(path)[:step] if path.is_file() and step else []
        with atomic_file(path) as temporary:
            temporary.write_text("".join(line + "\n" for line in kept), encoding="utf-8")
        self._waiting: list[str] = []

    def add(self, figures: dict[str, float]) -> None:
        """Append one step; `flush` writes it to disk."""
        self._waiting.append(json.dumps({name: round(value, 6) for name, value in figures.items()}) + "\n")

    def flush(self) -> None:
        """Write the added steps to disk.

        Raises:
            InputError: the file cannot be written.
        """
        lines, self._waiting = self._waiting, []
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.writelines(lines)
        except OSError as error:
            raise InputError(f"{self._path}: cannot be written ({error.strerror or error}).") from error


def read_log(path: Path) -> list[dict[str, float]]:
    """Read the figures of all steps in a run's log; empty if there is no log.

    An unfinished line of a stopped run is skipped, with a warning.

    Raises:
        InputError: the file cannot be read.
    """
    rows: list[dict[str, float]] = []
    lines = _lines(path) if path.is_file() else []
    for line in lines:
        with suppress(InputError):
            members = parse_json(line, str(path), "the figures of a step", with_constants=True).members()
            row = {name: float(member.value) for name, member in members.items() if type(member.value) in (int, float)}
            if "step" in row:
                rows.append(row)
    if len(rows) < len(lines):
        log.warning("%s: %d of %d lines cannot be read and are left out.", path, len(lines) - len(rows), len(lines))
    return rows


def read_losses(path: Path) -> dict[str, list[tuple[float, float]]]:
    """Loss curves of a run's log, thinned to at most 400 averages each; empty without a log."""
    rows = read_log(path)
    names = {name for row in rows for name in row} - {"step", "seconds"}
    width = max(1, math.ceil(len(rows) / 400))
    series: dict[str, list[tuple[float, float]]] = {}
    for name in sorted(names):
        points = [(row["step"], row[name]) for row in rows if name in row]
        blocks = [points[start : start + width] for start in range(0, len(points), width)]
        series[name] = [(block[-1][0], sum(y for _, y in block) / len(block)) for block in blocks]
    return series


def _lines(path: Path) -> list[str]:
    return read_bytes(path, "the log of a run").decode("utf-8", errors="replace").splitlines()


def loss_label(name: str) -> str:
    """What a loss measures, in plain words; its name if it is none of `LOSSES`."""
    return LOSSES.get(name, name)
