"""The progress of a batch on standard error: a table that is redrawn, or a line for every change."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from neural_strands.batch.plan import Plan, Row
from neural_strands.batch.subjects import STAGES, Stage

MOST_ROWS = 40
"""Largest number of rows on a terminal; running and failed subjects come first."""
LINE_SECONDS = 60.0
"""Interval between two lines about the whole batch without a terminal, seconds."""


@contextmanager
def shown(terminal: bool | None = None) -> Iterator[Callable[[Plan], None]]:
    """Yield a function that shows a plan.

    Args:
        terminal: whether a table can be redrawn; None tests whether standard error is a terminal.
    """
    if not (sys.stderr.isatty() if terminal is None else terminal):
        yield _Lines()
        return
    with Live(console=Console(stderr=True), refresh_per_second=2) as live:
        yield lambda plan: live.update(table(plan))


def table(plan: Plan) -> Table:
    """Subjects and the states of their stages."""
    rows = sorted(plan.rows.values(), key=lambda row: (not row.running, not row.failure, row.stage is None))
    drawn = Table(title=whole(plan))
    for head in ("subject", *STAGES, ""):
        drawn.add_column(head)
    for row in rows[:MOST_ROWS]:
        drawn.add_row(row.subject.name, *(state(row, stage) for stage in STAGES), Text(row.failure or row.news))
    if len(rows) > MOST_ROWS:
        drawn.add_row(f"and {len(rows) - MOST_ROWS} more")
    return drawn


def state(row: Row, stage: Stage) -> str:
    """One cell: the time of a completed stage, or its state."""
    if stage not in row.subject.stages:
        return "given"
    if stage in row.records:
        return duration(row.records[stage].seconds)
    if row.failure:
        return "failed" if stage == row.stage else "-"
    return "runs" if row.running and stage == row.stage else "waits"


def whole(plan: Plan) -> str:
    """The progress of all subjects in one line."""
    rows = plan.rows.values()
    done = sum(row.stage is None for row in rows)
    running = sum(row.running for row in rows)
    return f"{done} of {len(rows)} subjects done, {running} in work, {len(plan.failures)} failed"


def duration(seconds: float) -> str:
    """Seconds below two minutes, then minutes, then hours."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


class _Lines:
    """Reports each change once, and the whole batch once a minute."""

    def __init__(self) -> None:
        self._reported: dict[str, tuple[int, int, str]] = {}
        self._when = time.monotonic()

    def __call__(self, plan: Plan) -> None:
        for name, row in plan.rows.items():
            now = (len(row.records), row.losses, row.failure)
            before = self._reported.get(name)
            self._reported[name] = now
            if before is None or before == now:
                if before is None and row.failure:
                    self._say(f"{name}: {row.failure}")
                continue
            if row.failure:
                self._say(f"{name}: {row.failure}")
            elif now[1] > before[1]:
                self._say(f"{name}: {row.stage}: {row.news}")
            else:
                last = list(row.records)[-1]
                self._say(f"{name}: {last} done in {duration(row.records[last].seconds)}")
        if time.monotonic() - self._when > LINE_SECONDS:
            self._when = time.monotonic()
            self._say(whole(plan))

    def _say(self, sentence: str) -> None:
        sys.stderr.write(f"{sentence}\n")
        sys.stderr.flush()
