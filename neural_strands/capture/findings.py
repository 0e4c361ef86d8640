"""The findings of `check`, each one row of its table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Level = Literal["good", "note", "warning", "error"]
MOST_NAMES = 5
"""Views named in one row; the others are only counted."""


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes:
        topic: what was checked.
        level: good; note (absent but optional); warning (the result will suffer); error (must be fixed first).
        message: what was found, or what is wrong.
        action: what to do about it, empty if nothing.
        views: names of the views concerned.
    """

    topic: str
    level: Level
    message: str
    action: str = ""
    views: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The message with the first few views concerned."""
        if not self.views:
            return self.message
        more = len(self.views) - MOST_NAMES
        return f"{self.message}: {', '.join(self.views[:MOST_NAMES])}" + (f" and {more} more" if more > 0 else "")


def worst(findings: Sequence[Finding]) -> Level:
    """The most serious level among findings; good if there are none."""
    order: tuple[Level, ...] = ("good", "note", "warning", "error")
    return order[max((order.index(finding.level) for finding in findings), default=0)]
