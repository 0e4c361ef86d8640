"""One stage of one subject, as a node does it: in its folder, on its device, with every failure made one sentence."""

import platform
import sys
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
from neural_strands.foundation.progress import Feedback

NEWS_SECONDS = 2.0
"""Least time between two reports of a loop's progress."""


@dataclass(frozen=True)
class Task:
    """What a node is asked to do.

    Attributes:
        subject: whose turn it is.
        stage: which.
        out: place of the batch.
        demand: what the node lends to it; `gpu` is resolved.
        version: of the program that asks.
    """

    subject: Subject
    stage: Stage
    out: str
    demand: Demand
    version: str = __version__


@dataclass(frozen=True)
class Outcome:
    """What came of a task.

    Attributes:
        record: of the stage, if it is done.
        failure: one sentence, if it cannot be done.
    """

    record: StageRecord | None = None
    failure: str = ""


def perform(task: Task, tell: Callable[[str], None]) -> Outcome:
    """Do a task; bad input and faults of the program fail this task alone.

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
    record = StageRecord(stage, seconds, peak_bytes(), platform.node(), figures)
    # The last thing that is written: a stage with a record is done.
    write_record(store, record)
    return record


def _device(demand: Demand) -> Any:
    """The device of a task, with as many threads as it may use cores."""
    import torch

    torch.set_num_threads(demand.cores)
    if not demand.gpu:
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise InputError(f"{platform.node()}: expected a CUDA device, found none; set the stage's gpu to 0.")
    # Ray shows a task only the GPUs that it may use.
    torch.cuda.set_device(0)
    return torch.device("cuda", 0)


def peak_bytes() -> int:
    """Largest memory that this process has had; 0 where the system does not say."""
    try:
        import resource
    except ImportError:
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _feedback(tell: Callable[[str], None]) -> Feedback:
    """Reports of a stage, with loops told every few seconds."""

    def track(items: Iterable[Any], description: str, total: int | None = None) -> Iterator[Any]:
        told = time.monotonic()
        for done, item in enumerate(items):
            if (now := time.monotonic()) - told >= NEWS_SECONDS:
                told = now
                tell(f"{description}: {done}" + (f" of {total}" if total is not None else ""))
            yield item

    return Feedback(tell, track)
