"""Times work beside a twin of it or a peer, in alternation, so that both see the same load of the machine."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

Work = Callable[[], object]


@dataclass(frozen=True)
class Beside:
    """What some work takes, and its twin.

    Attributes:
        what: the work.
        ours: milliseconds, the lowest of several runs: processor time on a CPU, wall time on a GPU.
        theirs: the same of the twin; None if there is none.
        twin: what the twin is.
    """

    what: str
    ours: float
    theirs: float | None = None
    twin: str = ""


def milliseconds(work: Work, device: torch.device | str) -> float:
    """Processor time of one run on a CPU, all threads together; on a GPU, wall time until it has done the work."""
    on_gpu = torch.device(device).type == "cuda"
    clock = time.perf_counter if on_gpu else time.process_time
    began = clock()
    work()
    if on_gpu:
        torch.cuda.synchronize()
    return 1e3 * (clock() - began)


def beside(
    what: str, work: Work, twin: tuple[str, Work] | None = None, device: torch.device | str = "cpu", runs: int = 5
) -> Beside:
    """Run work and its twin once each to warm up, then alternately.

    Args:
        what: name of the work.
        work: ours.
        twin: its name, and what it does; None if there is none.
        device: where.
        runs: number of timed runs of each.
    """
    if twin is None:
        milliseconds(work, device)
        return Beside(what, min(milliseconds(work, device) for _ in range(runs)))
    for each in (work, twin[1]):
        milliseconds(each, device)
    pairs = [(milliseconds(work, device), milliseconds(twin[1], device)) for _ in range(runs)]
    ours, theirs = zip(*pairs, strict=True)
    return Beside(what, min(ours), min(theirs), twin[0])


def table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Rows in columns: the first to the left, the others to the right; floats with one decimal."""
    cells = [[f"{cell:.1f}" if isinstance(cell, float) else str(cell) for cell in row] for row in (heads, *rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(cell.rjust(width) if place else cell.ljust(width) for place, (cell, width) in enumerate(columns))
        for columns in (zip(row, widths, strict=True) for row in cells)
    ]
    return "\n".join(line.rstrip() for line in lines)


def beside_table(rows: Sequence[Beside], device: torch.device | str = "cpu") -> str:
    """All work and its twins."""
    unit = "wall ms" if torch.device(device).type == "cuda" else "processor ms"
    named = [
        (row.what, row.ours, *(("", "", "") if row.theirs is None else (row.theirs, row.theirs / row.ours, row.twin)))
        for row in rows
    ]
    return table((unit, "ours", "twin", "ratio", "what the twin is"), named)
