"""The figures of the steps of a fit: they stay on the device until they are read, several steps at a time."""

import time

import torch
from jaxtyping import Float
from torch import Tensor


class StepFigures:
    """Figures of the steps since the last reading."""

    def __init__(self, every: int) -> None:
        """Let figures be due after `every` steps; the host waits for the device only when they are read."""
        self._every = every
        self._kept: list[tuple[int, dict[str, Float[Tensor, ""]]]] = []
        self._began = 0.0

    def begin(self) -> None:
        """Note that a step begins."""
        if not self._kept:
            self._began = time.perf_counter()

    def add(self, step: int, figures: dict[str, Float[Tensor, ""]]) -> None:
        """Keep the figures of a step that is the `step`th, counted from 1."""
        self._kept.append((step, figures))

    @property
    def due(self) -> bool:
        """Whether figures of enough steps have been kept to read them."""
        return len(self._kept) >= self._every

    def read(self) -> list[dict[str, float]]:
        """The figures of each step, with `step` and `seconds`, the mean of the steps that are read together."""
        if not self._kept:
            return []
        kept, self._kept = self._kept, []
        numbers = iter(torch.stack([value for _, figures in kept for value in figures.values()]).tolist())
        # The numbers are there only when the device has done all steps, so the time covers them completely.
        seconds = (time.perf_counter() - self._began) / len(kept)
        return [
            {name: next(numbers) for name in figures} | {"step": float(step), "seconds": seconds}
            for step, figures in kept
        ]
