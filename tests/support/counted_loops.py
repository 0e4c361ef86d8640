"""A receiver of progress that counts what it is told, for tests of loops that report how far they are."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Loop:
    """A loop whose progress is reported.

    Attributes:
        title: its description.
        total: number of its steps, as it was announced.
        done: steps that have ended.
        ended: whether the loop has said that there are no more.
    """

    title: str
    total: int
    done: int = 0
    ended: bool = False

    @property
    def complete(self) -> bool:
        """Whether a progress bar would have reached 100 %, and not gone beyond."""
        return self.ended and self.done == self.total


@dataclass
class CountedLoops:
    """Loops in the order in which they began; `track` is that of a `Feedback`."""

    loops: list[Loop] = field(default_factory=list)

    def track(self, items: Iterable[Any], title: str, total: int) -> Iterator[Any]:
        """Yield the items and count them."""
        self.loops.append(loop := Loop(title, total))
        for item in items:
            yield item
            loop.done += 1
        loop.ended = True
