"""Reports of long computations: messages, and progress on standard error."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress

T = TypeVar("T")
Track = Callable[[Iterable[Any], str, int], Iterable[Any]]
"""Shows the progress of a loop: given the items, a description and their number, it returns the items."""

SECONDS_A_LINE = 60.0
"""Seconds between progress lines if there is no terminal."""


def _unsaid(_: str) -> None:
    pass


def untracked(items: Iterable[Any], _description: str, _total: int | None = None) -> Iterable[Any]:
    """Return the items: a `Track` that shows nothing."""
    return items


class Steps:
    """Progress of steps that are not one loop, from the first to the last of a number known in advance."""

    def __init__(self, track: Track, description: str, total: int) -> None:
        self._left = iter(track(range(total), description, total))
        next(self._left, None)

    def done(self) -> None:
        """Count one step."""
        next(self._left, None)


@dataclass(frozen=True)
class Feedback:
    """Receives the reports of a long computation; by default they are dropped.

    Attributes:
        say: receives one sentence at each stage.
        track: shows the progress of a loop.
    """

    say: Callable[[str], None] = _unsaid
    track: Track = untracked

    @property
    def heard(self) -> bool:
        """Whether anybody receives the sentences."""
        return self.say is not _unsaid


def progress_bar() -> "Progress":
    """Return a rich progress display that shows nothing unless standard error is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
    )


def track(
    items: Iterable[T],
    description: str,
    total: int | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[T]:
    """Yield `items`; standard error shows how many are done: a bar on a terminal, else one line per minute."""
    if sys.stderr.isatty():
        with progress_bar() as bar:
            yield from bar.track(items, total=total, description=description)
        return
    told = clock()
    for done, item in enumerate(items):
        if (now := clock()) - told >= SECONDS_A_LINE:
            told = now
            share = f"{done} of {total}" if total is not None else str(done)
            sys.stderr.write(f"{description}: {share}\n")
            sys.stderr.flush()
        yield item
