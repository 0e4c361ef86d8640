"""Data parallelism over processes: each takes its share of a step's views, and gradients are summed."""

import os
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import timedelta

import torch
from torch import distributed
from torch.nn import Parameter

PATIENCE = timedelta(hours=2)
"""How long processes wait for the one that computes segments; NCCL's default limit is ten minutes."""


@dataclass(frozen=True)
class Workers:
    """The processes of one fit, started by `torchrun`; a single process is a group of one.

    Attributes:
        rank: index of this process.
        count: number of processes.
    """

    rank: int = 0
    count: int = 1

    @classmethod
    def join(cls, device: torch.device) -> "Workers":
        """Join the group described by torchrun's environment variables, or form a group of one without them."""
        count = int(os.environ.get("WORLD_SIZE", "1"))
        if count == 1:
            return cls()
        if not distributed.is_initialized():
            distributed.init_process_group("nccl" if device.type == "cuda" else "gloo", timeout=PATIENCE)
        return cls(distributed.get_rank(), distributed.get_world_size())

    @property
    def leads(self) -> bool:
        """Whether this process writes files."""
        return self.rank == 0

    def share(self, items: int) -> range:
        """The items of a step that this process handles; every item belongs to exactly one process."""
        return range(self.rank, items, self.count)

    def sum_gradients(self, parameters: Iterable[Parameter]) -> None:
        """Sum each parameter's gradient over all processes, if any of them has one."""
        if self.count == 1:
            return
        for parameter in parameters:
            gradient = torch.zeros_like(parameter) if parameter.grad is None else parameter.grad
            distributed.all_reduce(gradient)
            parameter.grad = gradient

    def wait(self) -> None:
        """Wait until all processes reach this point."""
        if self.count > 1:
            distributed.barrier()

    def agree(self, number: int) -> int:
        """Return the leader's number in every process."""
        if self.count == 1:
            return number
        held = [number]
        distributed.broadcast_object_list(held, src=0)
        return held[0]

    def close(self) -> None:
        """Leave the group."""
        if self.count > 1:
            distributed.destroy_process_group()
