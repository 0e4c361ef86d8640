"""Runs tasks on a Ray cluster: one on this machine for the duration of the batch, or an existing one.

Ray's usage reports are off, and no dashboard is started.
"""

import logging
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from neural_strands.batch.subjects import Demand, Demands
from neural_strands.batch.task import Outcome, Task
from neural_strands.foundation.errors import InputError, reason

GIGABYTE = 10**9
STORE_BYTES = 10**8
"""Memory of a local cluster for results of tasks, bytes; they are small, because files are exchanged through
folders."""
SETTLE_SECONDS = 60.0
"""Time that stopped tasks may take to save their state, seconds."""


@dataclass(frozen=True)
class Lost:
    """A task whose worker or node has died.

    Attributes:
        why: the reason, in a few words.
    """

    why: str


@contextmanager
def cluster(address: str | None) -> Iterator["Cluster"]:
    """Join a cluster, or run one on this machine until the block ends.

    Args:
        address: `auto` for the cluster that this machine belongs to, or HOST or HOST:PORT of its head; None for a local
            one.

    Raises:
        InputError: Ray is not installed, or the cluster does not exist.
    """
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    # Otherwise Ray prints a deprecation notice about GPUs of tasks that request none.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError as error:
        raise InputError(
            "batch: expected the package ray, found none; run: pip install neural-strands[batch]."
        ) from error
    plain: dict[str, Any] = {"include_dashboard": False, "object_store_memory": STORE_BYTES}
    whole = address if address is None or address == "auto" or ":" in address else f"{address}:6379"
    try:
        ray.init(address=whole or "local", log_to_driver=False, logging_level=logging.ERROR, **({} if whole else plain))
    except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
        raise InputError(
            f"--address {address}: expected the head of a Ray cluster, found none ({reason(error)}); start one with "
            "`ray start --head`, or leave out --address."
        ) from error
    # Ray reports dead nodes on standard output, where results belong, even while it shuts down; the table shows them in
    # one line.
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        try:
            yield Cluster()
        finally:
            ray.shutdown()


class Cluster:
    """The cluster that this process has joined."""

    def __init__(self) -> None:
        import ray
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        self._running: dict[Any, str] = {}
        # Run the board on the node of this process, which the batch cannot outlive anyway.
        here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
        board: Any = ray.remote(_Board)
        self._board: Any = board.options(num_cpus=0, scheduling_strategy=here).remote()

    @property
    def cores(self) -> int:
        """Number of processor cores of all live nodes."""
        import ray

        return max(1, int(ray.cluster_resources().get("CPU", 1)))

    def resolved(self, demands: Demands) -> Demands:
        """Fill in unspecified GPU demands: a GPU if the cluster has any."""
        import ray

        share = 1.0 if ray.cluster_resources().get("GPU", 0) >= 1 else 0.0
        return Demands(*(_with_gpu(each, share) for each in vars(demands).values()))

    def too_small_for(self, demand: Demand) -> str | None:
        """Describe what every live node lacks for a task; None if some node can run it."""
        import ray

        wanted = {"CPU": demand.cores, "GPU": demand.gpu or 0.0, "memory": demand.memory * GIGABYTE}
        nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
        if any(all(node.get(name, 0) >= amount for name, amount in wanted.items()) for node in nodes):
            return None
        most = {name: max((node.get(name, 0) for node in nodes), default=0) for name in wanted}
        return (
            f"a node with {demand.cores} cores, {wanted['GPU']:g} GPUs and {demand.memory:g} GB, found at most "
            f"{most['CPU']:g}, {most['GPU']:g} and {math.floor(10 * most['memory'] / GIGABYTE) / 10:g}"
        )

    def submit(self, name: str, task: Task) -> None:
        """Hand a task to the cluster.

        Args:
            name: name of the subject; only one task of a subject runs at a time.
            task: the task.
        """
        import ray

        # Run every task in a new process, so that nothing of an earlier one remains in memory or on the GPU.
        remote: Any = ray.remote(max_calls=1)(_perform)
        ref = remote.options(
            num_cpus=task.demand.cores,
            num_gpus=task.demand.gpu or 0.0,
            memory=int(task.demand.memory * GIGABYTE),
            max_retries=0,
            name=f"{name}: {task.stage}",
        ).remote(task, self._board)
        self._running[ref] = name

    @property
    def handed_out(self) -> int:
        """Number of tasks that have been submitted and have not ended."""
        return len(self._running)

    def ended(self, seconds: float) -> list[tuple[str, Outcome | Lost]]:
        """Tasks that have ended; waits at most `seconds` for the first."""
        import ray

        refs = list(self._running)
        ready, _ = ray.wait(refs, num_returns=1, timeout=seconds) if refs else ([], [])
        if ready:
            ready, _ = ray.wait(refs, num_returns=len(refs), timeout=0)
        return [(self._running.pop(ref), _outcome(ref)) for ref in ready]

    def news(self) -> dict[str, str]:
        """The latest report of each subject's task since the last call."""
        import ray
        from ray.exceptions import RayError

        try:
            return ray.get(self._board.taken.remote(), timeout=10.0)
        except RayError:
            # Progress is optional: without the board the work continues.
            return {}

    def stop(self) -> None:
        """Interrupt all tasks as Ctrl-C would, and wait for them to save their state."""
        import ray

        for ref in self._running:
            ray.cancel(ref, force=False)
        if self._running:
            ray.wait(list(self._running), num_returns=len(self._running), timeout=SETTLE_SECONDS)


class _Board:
    """Collects the reports of tasks, in a process of its own."""

    def __init__(self) -> None:
        self._latest: dict[str, str] = {}

    def tell(self, name: str, sentence: str) -> None:
        self._latest[name] = sentence

    def taken(self) -> dict[str, str]:
        latest, self._latest = self._latest, {}
        return latest


def _perform(task: Task, board: Any) -> Outcome:
    """Perform a task in a worker."""
    from neural_strands.batch.task import perform

    return perform(task, lambda sentence: board.tell.remote(task.subject.name, sentence))


def _outcome(ref: Any) -> Outcome | Lost:
    """The result of a task that has ended."""
    import ray
    from ray.exceptions import RayError, RayTaskError

    try:
        return ray.get(ref)
    except RayTaskError as error:
        return Outcome(failure=f"the node cannot run it ({reason(error.cause or error)}); install the program there.")
    except RayError as error:
        return Lost(f"{type(error).__name__}: {reason(error)}")


def _with_gpu(demand: Demand, share: float) -> Demand:
    return demand if demand.gpu is not None else replace(demand, gpu=share)
