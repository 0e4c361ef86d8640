"""Plans which stage of which subject comes next, and tracks the results; independent of the executor."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from neural_strands.batch.records import StageRecord
from neural_strands.batch.subjects import STAGES, Stage, Subject
from neural_strands.batch.task import Outcome


@dataclass
class Row:
    """The state of one subject.

    Attributes:
        subject: the subject.
        records: records of its completed stages.
        running: whether one of its stages has been submitted.
        lost: number of workers that died in its present stage.
        losses: number of workers that died in all stages.
        failure: a sentence that names the stage, if the subject has failed, else empty.
        news: the last report of its stage.
    """

    subject: Subject
    records: dict[Stage, StageRecord] = field(default_factory=dict)
    running: bool = False
    lost: int = 0
    losses: int = 0
    failure: str = ""
    news: str = ""

    @property
    def stage(self) -> Stage | None:
        """The stage that is running or next; None once all are done."""
        return next((stage for stage in self.subject.stages if stage not in self.records), None)

    @property
    def waits(self) -> bool:
        """Whether its next stage can be submitted."""
        return self.stage is not None and not self.running and not self.failure


class Plan:
    """The rows of a batch, in the order of its file."""

    def __init__(self, subjects: Iterable[Subject], retries: int) -> None:
        """Start without completed stages.

        Args:
            subjects: all of them.
            retries: number of times that a stage is retried after its worker or node has died.
        """
        self.rows = {subject.name: Row(subject) for subject in subjects}
        self._retries = retries

    def known(self, name: str, records: Mapping[Stage, StageRecord]) -> None:
        """Add stages that earlier runs have completed."""
        self.rows[name].records.update(records)

    def next(self) -> Row | None:
        """The subject to submit next: the one furthest along, so that results come early and files do not pile up."""
        waiting = [row for row in self.rows.values() if row.waits]
        return max(waiting, key=lambda row: STAGES.index(row.stage or STAGES[0]), default=None)

    def ended(self, name: str, outcome: Outcome) -> None:
        """Record that a stage has succeeded, or failed its subject."""
        row = self.rows[name]
        stage, row.running, row.news = row.stage, False, ""
        if outcome.record is not None:
            row.records[outcome.record.stage], row.lost = outcome.record, 0
        else:
            row.failure = f"{stage}: {outcome.failure}"

    def died(self, name: str, why: str) -> None:
        """Record that the worker or node of a stage has died: the stage is retried, or the subject fails."""
        row = self.rows[name]
        row.running, row.lost, row.losses = False, row.lost + 1, row.losses + 1
        row.news = f"lost ({why}), tried again"
        if row.lost > self._retries:
            row.failure = f"{row.stage}: its worker died {row.lost} times, the last time because: {why}."

    def failed(self, name: str, sentence: str) -> None:
        """Record that a subject cannot start."""
        self.rows[name].failure = sentence

    @property
    def failures(self) -> dict[str, str]:
        """The errors of failed subjects."""
        return {name: row.failure for name, row in self.rows.items() if row.failure}

    @property
    def over(self) -> bool:
        """Whether nothing is running and nothing can be submitted."""
        return not any(row.running or row.waits for row in self.rows.values())
