"""The report: one self-contained HTML file."""

import base64
from dataclasses import dataclass
from pathlib import Path

import jinja2

from neural_strands.foundation.files import atomic_file

TEMPLATE = Path(__file__).parent / "templates" / "report.html"


@dataclass(frozen=True)
class Table:
    """Rows of text under a heading.

    Attributes:
        title: heading of the table.
        heads: heads of the columns.
        rows: cells, one per column.
        note: a sentence below the table.
        links: target of the first cell of each row, empty for none; an empty tuple for a table without links.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    links: tuple[str, ...] = ()


@dataclass(frozen=True)
class Gallery:
    """Pictures under a heading.

    Attributes:
        title: heading of the pictures.
        pictures: caption and PNG of each.
        columns: pictures per row.
    """

    title: str
    pictures: tuple[tuple[str, bytes], ...]
    columns: int = 3


@dataclass(frozen=True)
class Turntable:
    """Moving pictures of a full turn, side by side.

    Attributes:
        title: heading of the moving pictures.
        strips: caption and WebP of each: square frames, evenly spaced over the turn, one below the other.
        frames: number of frames per strip.
        seconds: duration of a turn.
    """

    title: str
    strips: tuple[tuple[str, bytes], ...]
    frames: int
    seconds: float = 4.0


def write_page(
    path: Path,
    title: str,
    summary: str,
    tables: list[Table],
    galleries: list[Gallery],
    turntable: Turntable | None = None,
) -> None:
    """Write the page; pictures are embedded.

    Raises:
        InputError: the file cannot be written.
    """
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters["embedded"] = _embedded
    template = environment.from_string(TEMPLATE.read_text(encoding="utf-8"))
    page = template.render(title=title, summary=summary, tables=tables, galleries=galleries, turntable=turntable)
    with atomic_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _embedded(data: bytes, kind: str = "png") -> str:
    return f"data:image/{kind};base64," + base64.b64encode(data).decode("ascii")
