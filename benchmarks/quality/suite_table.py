"""The rows of the synthetic suite: one file for each case and seed, and the table of all of them."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import torch
from suite_cases import CASES

from neural_strands.foundation.files import atomic_file, write_json

HEADS = ("case", "half", "seed", "strands", "F 1 / 2 / 3 mm", "consistency", "length", "inside", "stereo")


@dataclass(frozen=True)
class Row:
    """Figures of one case and seed."""

    case: str
    half: str
    seed: int
    strands: int
    f_scores: list[float]
    """Percent, at each threshold."""
    segment_scores: list[list[float]]
    """Precision and recall of the line segments, percent, at each threshold."""
    consistency: float
    """Percent at 2 mm."""
    length_ratios: list[float]
    """Found to true: median and 95th percentile, of strands that grow where true ones do."""
    inside: float
    """Percent of points inside the head."""


@dataclass
class Table:
    """Rows as text, the first with the heads."""

    rows: list[tuple[str, ...]]

    def add(self, case: str, half: str, seed: str, groups: Sequence[Sequence[Row]]) -> None:
        """Append the mean over groups of the mean of each group's rows: every case counts alike."""

        def mean(figure: Callable[[Row], list[float]], form: str) -> str:
            means = [torch.tensor([figure(row) for row in group], dtype=torch.float64).mean(dim=0) for group in groups]
            return slashed(torch.stack(means).mean(dim=0).tolist(), form)

        self.rows.append(
            (
                case,
                half,
                seed,
                mean(lambda row: [row.strands], "{:.0f}"),
                mean(lambda row: row.f_scores, "{:.1f}"),
                mean(lambda row: [row.consistency], "{:.1f}"),
                mean(lambda row: row.length_ratios, "{:.2f}"),
                mean(lambda row: [row.inside], "{:.2f}"),
                mean(lambda row: row.segment_scores[1], "{:.1f}"),
            )
        )

    def text(self) -> str:
        """Columns aligned to the right, the first to the left."""
        widths = [max(len(row[k]) for row in self.rows) for k in range(len(self.rows[0]))]
        lines = (
            "  ".join([row[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(row[1:], widths[1:], strict=True))])
            for row in self.rows
        )
        return "\n".join(lines) + "\n"


def row_path(folder: Path, case: str, seed: int) -> Path:
    """The file of a row."""
    return folder / f"{case}_{seed}.json"


def read_rows(folder: Path) -> list[Row]:
    """All rows in a folder, in the order of the cases and their seeds, with the halves that the cases belong to now."""
    rows = []
    for case in CASES:
        seeds = [path.stem.removeprefix(f"{case.name}_") for path in folder.glob(f"{case.name}_*.json")]
        for seed in sorted(map(int, filter(str.isdigit, seeds))):
            rows.append(replace(_read_row(row_path(folder, case.name, seed)), half=case.half))
    return rows


def write_results(folder: Path) -> str:
    """Write FOLDER.json and FOLDER.txt from all rows in FOLDER; returns the text."""
    rows = read_rows(folder)
    text = table(rows)
    write_json(folder.with_name(f"{folder.name}.json"), {"rows": [asdict(row) for row in rows]})
    with atomic_file(folder.with_name(f"{folder.name}.txt")) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return text


def table(rows: Sequence[Row]) -> str:
    """All rows, the means of cases and halves, and the case of the test half with the lowest mean at 2 mm."""
    found, groups = Table([HEADS]), by_case(rows)
    for group in groups:
        for row in group:
            found.add(row.case, row.half, str(row.seed), [[row]])
        if len(group) > 1:
            found.add(group[0].case, group[0].half, "mean", [group])
    for half in ("tuning", "test"):
        members = [group for group in groups if group[0].half == half]
        if members:
            known = sum(case.half == half for case in CASES)
            found.add(f"mean of {len(members)} of {known} cases", half, "all", members)
    tested = [group for group in groups if group[0].half == "test"]
    if tested:
        worst = min(tested, key=lambda group: sum(row.f_scores[1] for row in group) / len(group))
        found.add(f"worst: {worst[0].case}", "test", "all", [worst])
    spread = seed_spread(groups)
    return found.text() + (f"F's standard deviation over seeds, mean over cases: {spread}\n" if spread else "")


def by_case(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows of each case."""
    return [[row for row in rows if row.case == case] for case in dict.fromkeys(row.case for row in rows)]


def seed_spread(groups: Sequence[Sequence[Row]]) -> str:
    """Standard deviation of F over the seeds of a case, mean over all cases; empty for single seeds."""
    spreads = [torch.tensor([row.f_scores for row in group]).std(dim=0) for group in groups if len(group) > 1]
    return slashed(torch.stack(spreads).mean(dim=0).tolist(), "{:.2f}") if spreads else ""


def slashed(values: Sequence[float], form: str) -> str:
    """Numbers in one cell."""
    return " / ".join(form.format(value) for value in values)


def _read_row(path: Path) -> Row:
    found = json.loads(path.read_text(encoding="utf-8"))
    if set(found) != {field.name for field in fields(Row)}:
        raise SystemExit(f"{path}: expected the figures of this version, found others; choose another --label.")
    return Row(**found)
