"""Which stage of which subject comes next, and what has become of all; pure, so that any executor can follow it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from neural_strands.batch.records import StageRecord
from neural_strands.batch.subjects import STAGES, Stage, Subject
from neural_strands.batch.task import Outcome


@dataclass
class Row:
    """One subject's way through its stages.

    Attributes:
        subject: whose.
        records: of the stages that are done.
        running: whether a stage of it has been handed out.
        lost: how many workers have died under its present stage.
        losses: how many have died in all.
        failure: one sentence that names the stage, if the subject has failed.
        news: what its stage last reported.
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
        """The stage that comes next or runs; None once all are done."""
        return next((stage for stage in self.subject.stages if stage not in self.records), None)

    @property
    def waits(self) -> bool:
        """Whether its next stage could be handed out."""
        return self.stage is not None and not self.running and not self.failure


class Plan:
    """The rows of a batch, in the order of its file."""

    def __init__(self, subjects: Iterable[Subject], retries: int) -> None:
        """Begin with nothing done.

        Args:
            subjects: all of them.
            retries: how often a stage is tried again after the worker or the node that ran it has died.
        """
        self.rows = {subject.name: Row(subject) for subject in subjects}
        self._retries = retries

    def known(self, name: str, records: Mapping[Stage, StageRecord]) -> None:
        """Take over the stages that earlier runs have done."""
        self.rows[name].records.update(records)

    def next(self) -> Row | None:
        """The subject to hand out: the furthest on, so that results come early and inputs do not pile up."""
        waiting = [row for row in self.rows.values() if row.waits]
        return max(waiting, key=lambda row: STAGES.index(row.stage or STAGES[0]), default=None)

    def ended(self, name: str, outcome: Outcome) -> None:
        """A stage has ended: well, or with a sentence that fails its subject."""
        row = self.rows[name]
        stage, row.running, row.news = row.stage, False, ""
        if outcome.record is not None:
            row.records[outcome.record.stage], row.lost = outcome.record, 0
        else:
            row.failure = f"{stage}: {outcome.failure}"

    def died(self, name: str, why: str) -> None:
        """The worker of a stage, or its node, is gone: the stage is tried again, or the subject fails."""
        row = self.rows[name]
        row.running, row.lost, row.losses = False, row.lost + 1, row.losses + 1
        row.news = f"lost ({why}), tried again"
        if row.lost > self._retries:
            row.failure = f"{row.stage}: its worker died {row.lost} times, the last time because: {why}."

    def failed(self, name: str, sentence: str) -> None:
        """A subject cannot begin."""
        self.rows[name].failure = sentence

    @property
    def failures(self) -> dict[str, str]:
        """Sentences of the subjects that have failed."""
        return {name: row.failure for name, row in self.rows.items() if row.failure}

    @property
    def over(self) -> bool:
        """Whether nothing runs and nothing can."""
        return not any(row.running or row.waits for row in self.rows.values())
