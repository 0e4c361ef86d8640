"""The page about a batch, OUT/index.html: figures and a thumbnail of every subject, and failures with reasons."""

import tempfile
from pathlib import Path

from neural_strands.batch.plan import Plan, Row
from neural_strands.batch.records import FIGURES, THUMBNAIL
from neural_strands.batch.storage import Store
from neural_strands.batch.subjects import STAGES
from neural_strands.batch.table import duration, whole
from neural_strands.evaluation.page import Gallery, Table, write_page

PAGE = "index.html"
MOST_THUMBNAILS = 200
"""Largest number of thumbnails; with more, the page would load slowly."""
REPORT = "run/report/index.html"


def write_summary(out: Store, plan: Plan) -> None:
    """Write the page.

    Raises:
        InputError: the folder cannot be written to.
    """
    rows = list(plan.rows.values())
    done = [row for row in rows if row.stage is None]
    tables = [_failures(rows)] if plan.failures else []
    tables += [_figures(rows), _resources(rows)]
    pictures = []
    for row in done[:MOST_THUMBNAILS]:
        picture = out.child(row.subject.name).read(THUMBNAIL, "a small picture")
        if picture is not None:
            pictures.append((row.subject.name, picture))
    title = "Photograph, strands and rendering"
    if len(done) > MOST_THUMBNAILS:
        title += f" of the first {MOST_THUMBNAILS} subjects"
    galleries = [Gallery(title, tuple(pictures))] if pictures else []
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / PAGE
        write_page(page, "Neural Strands: a batch", f"{whole(plan)}.", tables, galleries)
        out.write(PAGE, page.read_bytes())


def _failures(rows: list[Row]) -> Table:
    failed = tuple((row.subject.name, row.failure) for row in rows if row.failure)
    return Table("Failed", ("subject", "why"), failed, "Give --resume once the cause is gone: what is done is kept.")


def _figures(rows: list[Row]) -> Table:
    """Figures of the evaluation; evaluated subjects link to their reports."""
    cells, links = [], []
    for row in rows:
        record = row.records.get("evaluate")
        found = {} if record is None else record.figures
        values = (f"{found[path]:.3f}" if path in found else "-" for path in FIGURES)
        cells.append((row.subject.name, *values))
        links.append("" if record is None else f"{row.subject.name}/{REPORT}")
    return Table("Figures", ("subject", *FIGURES.values()), tuple(cells), links=tuple(links))


def _resources(rows: list[Row]) -> Table:
    """Time and memory of every stage."""
    cells = []
    for row in rows:
        records = [row.records.get(stage) for stage in STAGES]
        told = (
            "-" if record is None else f"{duration(record.seconds)}, {record.peak_bytes / 1e9:.1f} GB, {record.node}"
            for record in records
        )
        cells.append((row.subject.name, *told))
    return Table("Time, memory and node of each stage", ("subject", *STAGES), tuple(cells))
