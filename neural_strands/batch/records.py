"""Files that a batch writes beside a subject's results: its settings, and a record of every completed stage."""

import json
from dataclasses import asdict, dataclass, field
from typing import Any

from neural_strands.batch.storage import Store
from neural_strands.batch.subjects import STAGES, Stage, Subject
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.json_files import JsonValue, check_format, parse_json

FORMAT = 1
"""Version of the files' layout."""
SUBJECT = "subject.json"
ADVICE = "remove the subject's folder, and it is done anew"
MOST_FIGURES = 100
THUMBNAIL = "thumbnail.png"
"""A small picture of the result in the folder of a subject."""
FIGURES = {
    "held_out_views.psnr": "PSNR, dB",
    "held_out_views.ssim": "SSIM",
    "held_out_views.lpips": "LPIPS",
    "strands_in_views_percent.direction": "direction within 20°, %",
    "strands_in_views_percent.on_background": "on background, %",
    "unseen_strands_percent": "unseen, %",
    "strands.2mm/20deg.f_score": "F at 2 mm, %",
}
"""Figures of an evaluation that are kept for the summary: their paths in it, and their column heads."""


@dataclass(frozen=True)
class StageRecord:
    """The record of a completed stage.

    Attributes:
        stage: the stage.
        seconds: duration of the attempt that completed it.
        peak_bytes: peak memory of its process.
        node: the node that ran it.
        figures: figures for the summary.
    """

    stage: Stage
    seconds: float
    peak_bytes: int
    node: str
    figures: dict[str, float] = field(default_factory=dict)


def record_name(stage: Stage) -> str:
    """Name of the file of a stage's record, in the subject's folder."""
    return f"stages/{stage}.json"


def write_record(store: Store, record: StageRecord) -> None:
    """Write the record of a completed stage.

    Raises:
        InputError: the folder cannot be written to.
    """
    store.write(record_name(record.stage), _bytes({"format": FORMAT, **asdict(record)}))


def read_record(store: Store, stage: Stage) -> StageRecord | None:
    """The record of a stage, or None if it is not done.

    Raises:
        InputError: the record is damaged.
    """
    written = _read(store, record_name(stage), "the record of a stage")
    if written is None:
        return None
    found = written.member("stage").choice(STAGES)
    if found != stage:
        raise written.member("stage").refuse(stage)
    figures = written.member("figures").members()
    if len(figures) > MOST_FIGURES:
        raise written.member("figures").refuse(f"at most {MOST_FIGURES} figures")
    return StageRecord(
        stage,
        written.member("seconds").number(0.0),
        written.member("peak_bytes").whole(0, 2**60),
        written.member("node").text(),
        {name: value.number() for name, value in figures.items()},
    )


def read_records(store: Store, subject: Subject) -> dict[Stage, StageRecord]:
    """Read the records of a subject's completed stages, up to the first incomplete one.

    Raises:
        InputError: a record is damaged, or the results were made with other settings.
    """
    records: dict[Stage, StageRecord] = {}
    for stage in subject.stages:
        record = read_record(store, stage)
        if record is None:
            break
        records[stage] = record
    # Without records there is nothing to check here: each stage compares its own inputs when it continues.
    if records:
        _check_same(store, subject)
    return records


def _check_same(store: Store, subject: Subject) -> None:
    written = _read(store, SUBJECT, "the settings of a subject")
    if written is None:
        raise InputError(f"{store.place}: expected {SUBJECT} beside the records of stages, found none; {ADVICE}.")
    ours = json.loads(json.dumps(subject.as_dict()))
    stored = written.member("subject").members()
    for name, value in ours.items():
        if name not in stored or stored[name].value != value:
            raise InputError(
                f"{store.place}: its results were begun with another {name} than the subjects file has now; restore "
                "that, or name another folder."
            )


def write_subject(store: Store, subject: Subject) -> None:
    """Write the settings of a subject that is about to start.

    Raises:
        InputError: the folder cannot be written to.
    """
    store.write(SUBJECT, _bytes({"format": FORMAT, "subject": subject.as_dict()}))


def _bytes(document: dict[str, Any]) -> bytes:
    return (json.dumps(document, indent=1) + "\n").encode()


def _read(store: Store, name: str, what: str) -> JsonValue | None:
    content = store.read(name, what)
    if content is None:
        return None
    written = parse_json(content.decode("utf-8", errors="replace"), f"{store.place}: {name}", what, ADVICE)
    check_format(written, FORMAT)
    return written
