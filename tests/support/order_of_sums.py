"""Finds sums of floats whose order torch leaves to its threads, so that their last bits differ from run to run.

On the CPU these are sums by `index_put`, which is the gradient of `values[index]`, where an index occurs several times.
The gradients of `index_select` and `gather` are summed in a fixed order.
"""

import traceback
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

PACKAGE = "neural_strands"


class UnorderedSums(TorchDispatchMode):
    """Notes each such sum while the block runs.

    Attributes:
        found: the lines of the package at which they were made, innermost last.
    """

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: tuple = (), kwargs: dict | None = None) -> Any:
        if "index_put" in func.name():
            given = dict(zip((argument.name for argument in func._schema.arguments), args, strict=False))
            self._note(given | (kwargs or {}))
        return func(*args, **(kwargs or {}))

    def _note(self, given: dict[str, Any]) -> None:
        """Note the lines from which `index_put` is called, if it adds floats at places that are named twice."""
        adds_floats = given.get("accumulate") and given["values"].is_floating_point()
        if adds_floats and _has_repeated_places(given["indices"]):
            lines = [line for line in traceback.extract_stack() if PACKAGE in line.filename]
            self.found.append("; ".join(f"{line.filename}:{line.lineno}" for line in lines[-3:]))


def _has_repeated_places(indices: Sequence[Tensor | None]) -> bool:
    """Whether an entry of the result is named twice."""
    numbers: list[Tensor] = []
    for index in indices:
        if index is not None:
            numbers += index.nonzero().unbind(1) if index.dtype == torch.bool else [index]
    places = torch.stack([each.flatten() for each in torch.broadcast_tensors(*numbers)], dim=1)
    return len(torch.unique(places, dim=0)) < len(places)
