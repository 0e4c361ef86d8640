"""Performs one stage of one subject on a node: in its folder, on its device; every failure becomes one sentence."""

import platform
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from neural_strands import __version__
from neural_strands.batch.records import StageRecord, read_record, write_record, write_subject
from neural_strands.batch.storage import Store, workspace
from neural_strands.batch.subjects import Demand, Stage, Subject
from neural_strands.foundation.errors import InputError, reason
from neural_strands.foundation.memory import peak_resident_memory
from neural_strands.foundation.progress import Feedback

NEWS_SECONDS = 2.0
"""Least time between two reports of a loop's progress."""


@dataclass(frozen=True)
class Task:
    """What a node is asked to do.

    Attributes:
        subject: the subject.
        stage: the stage.
        out: place of the batch.
        demand: resources of the node for it; `gpu` is set.
        version: version of the program that submits it.
    """

    subject: Subject
    stage: Stage
    out: str
    demand: Demand
    version: str = __version__


@dataclass(frozen=True)
class Outcome:
    """The result of a task.

    Attributes:
        record: record of the stage, if it was completed.
        failure: one sentence, if it failed, else empty.
    """

    record: StageRecord | None = None
    failure: str = ""


def perform(task: Task, tell: Callable[[str], None]) -> Outcome:
    """Perform a task; bad input and errors of the program fail only this task.

    Args:
        task: what to do.
        tell: receives short reports of progress.
    """
    if task.version != __version__:
        return Outcome(
            failure=f"{platform.node()}: expected neural-strands {task.version}, found {__version__}; install it there."
        )
    store = Store(task.out).child(task.subject.name)
    try:
        return Outcome(_done(task, store, tell))
    except InputError as error:
        return Outcome(failure=str(error))
    except Exception as error:
        name = f"stages/{task.stage}.error.txt"
        store.write(name, traceback.format_exc().encode())
        return Outcome(failure=f"a fault of the program ({type(error).__name__}: {reason(error)}); see {name}.")


def _done(task: Task, store: Store, tell: Callable[[str], None]) -> StageRecord:
    from neural_strands.batch.stages import NEEDED, WORK, StageWork, spared

    began = time.monotonic()
    subject, stage = task.subject, task.stage
    if (record := read_record(store, stage)) is not None:
        return record
    if stage == subject.stages[0]:
        write_subject(store, subject)
    device = _device(task.demand)
    with workspace(store, NEEDED[stage], spared(stage)) as folder:
        figures = WORK[stage](StageWork(subject, folder, device, _feedback(tell)))
    seconds = round(time.monotonic() - began, 1)
    record = StageRecord(stage, seconds, peak_resident_memory(), platform.node(), figures)
    # The record is written last: a stage with a record is complete.
    write_record(store, record)
    return record


def _device(demand: Demand) -> Any:
    """Select the device of a task, and limit its threads to its cores."""
    import torch

    torch.set_num_threads(demand.cores)
    if not demand.gpu:
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise InputError(f"{platform.node()}: expected a CUDA device, found none; set the stage's gpu to 0.")
    # Ray makes only the task's own GPUs visible.
    torch.cuda.set_device(0)
    return torch.device("cuda", 0)


def _feedback(tell: Callable[[str], None]) -> Feedback:
    """Feedback that reports messages, and the progress of loops every few seconds."""

    def track(items: Iterable[Any], description: str, total: int | None = None) -> Iterator[Any]:
        reported = time.monotonic()
        for done, item in enumerate(items):
            if (now := time.monotonic()) - reported >= NEWS_SECONDS:
                reported = now
                tell(f"{description}: {done}" + (f" of {total}" if total is not None else ""))
            yield item

    return Feedback(tell, track)
