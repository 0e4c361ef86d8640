"""What a check found: one row of the table."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Level = Literal["good", "note", "warning", "error"]
MOST_NAMES = 5
"""Views named in one row; of the others the number is given."""


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        topic: what was looked at.
        level: good; note (absent but optional); warning (the result will suffer); error (must be mended first).
        message: what is there, or what is wrong.
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
    """The gravest level among findings; good for none."""
    order: tuple[Level, ...] = ("good", "note", "warning", "error")
    return order[max((order.index(finding.level) for finding in findings), default=0)]
