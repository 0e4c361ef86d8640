"""Runs a batch from start to end: submits stages, collects results, shows progress, and writes the summary."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from neural_strands.batch.cluster import Cluster, Lost, cluster
from neural_strands.batch.plan import Plan
from neural_strands.batch.records import read_records
from neural_strands.batch.storage import Store, is_remote
from neural_strands.batch.subjects import STAGES, BatchFile, Demands
from neural_strands.batch.summary import write_summary
from neural_strands.batch.task import Task
from neural_strands.foundation.errors import InputError

BEGUN = "batch.json"
"""Name of the file in OUT that marks a batch that has started there."""
RETRIES = 3
LOOK_SECONDS = 1.0
"""Interval between two checks of the tasks, seconds."""
TASKS_A_CORE = 2
"""Submitted tasks per core of the cluster: enough to keep every node busy, few enough for late stages to precede early
ones."""


@dataclass(frozen=True)
class BatchRequest:
    """What to run, and where.

    Attributes:
        file: the subjects and demands.
        out: place of the results: a folder with the same path on all nodes, or a URL.
        address: address of a Ray cluster; None for a local one.
        resume: continue the batch in `out`.
        retries: number of times that a stage is retried after its worker or node has died.
    """

    file: BatchFile
    out: str
    address: str | None = None
    resume: bool = False
    retries: int = RETRIES


def run_batch(request: BatchRequest, show: Callable[[Plan], None], say: Callable[[str], None]) -> Plan:
    """Take every subject through its stages.

    Args:
        request: what to run.
        show: receives the plan after every change, and about once a second.
        say: receives messages.

    Returns:
        The plan, with the results of all subjects.

    Raises:
        InputError: there is no cluster, it is too small, or `out` contains a batch that should not be resumed.
    """
    out = Store(request.out if is_remote(request.out) else str(Path(request.out).absolute()))
    begun = out.read(BEGUN, "the mark of a batch") is not None
    if begun and not request.resume:
        raise InputError(
            f"{request.out}: expected no batch there yet, found one; continue it with --resume, or name another folder."
        )
    plan = Plan(request.file.subjects, request.retries)
    with cluster(request.address) as nodes:
        demands = nodes.resolved(request.file.demands)
        _check_sizes(plan, nodes, demands, waits=request.address is not None, say=say)
        out.write(BEGUN, (json.dumps({"subjects": list(plan.rows)}, indent=1) + "\n").encode())
        for name, row in plan.rows.items():
            try:
                plan.known(name, read_records(out.child(name), row.subject))
            except InputError as error:
                plan.failed(name, str(error))
        try:
            _follow(plan, nodes, out.place, demands, show)
        except BaseException:
            nodes.stop()
            raise
        finally:
            write_summary(out, plan)
    return plan


def _check_sizes(plan: Plan, nodes: Cluster, demands: Demands, waits: bool, say: Callable[[str], None]) -> None:
    """Refuse demands that no node meets; only warn if nodes may still join the cluster."""
    for stage in STAGES:
        if not any(stage in row.subject.stages for row in plan.rows.values()):
            continue
        missing = nodes.too_small_for(demands.of(stage))
        if missing is not None and not waits:
            raise InputError(f"resources.{stage}: expected {missing}; ask for less, or name a cluster with --address.")
        if missing is not None:
            say(f"{stage}: waiting for {missing}.")


def _follow(plan: Plan, nodes: Cluster, out: str, demands: Demands, show: Callable[[Plan], None]) -> None:
    """Submit and collect tasks until the plan is over."""
    while not plan.over:
        while nodes.handed_out < TASKS_A_CORE * nodes.cores and (row := plan.next()) is not None:
            stage = row.stage
            if stage is None:
                break
            nodes.submit(row.subject.name, Task(row.subject, stage, out, demands.of(stage)))
            row.running = True
        for name, result in nodes.ended(LOOK_SECONDS):
            if isinstance(result, Lost):
                plan.died(name, result.why)
            else:
                plan.ended(name, result)
        for name, sentence in nodes.news().items():
            if plan.rows[name].running:
                plan.rows[name].news = sentence
        show(plan)


def figures(plan: Plan, out: str) -> dict[str, Any]:
    """The output of `--json`: each subject's completed stages with figures, and its failure, if any."""
    rows = {
        name: {
            "failure": row.failure,
            "workers_lost": row.losses,
            "stages": {stage: {**vars(record)} for stage, record in row.records.items()},
        }
        for name, row in plan.rows.items()
    }
    return {"subjects": len(plan.rows), "failed": len(plan.failures), "out": out, "rows": rows}
