"""Timing of a function: median of several synchronised runs, and peak memory."""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch

from neural_strands.foundation.memory import peak_resident_memory


@dataclass(frozen=True)
class Timing:
    """Duration and peak memory of a function.

    Attributes:
        median: seconds.
        fastest: seconds; the most reliable figure on a shared machine.
        slowest: seconds.
        runs: number of measured runs.
        peak_bytes: on CUDA the most memory allocated during the runs; on CPU the peak of the process so far (0 if the
            platform does not report it).
    """

    median: float
    fastest: float
    slowest: float
    runs: int
    peak_bytes: int


def time_function(
    function: Callable[[], object], device: torch.device | str = "cpu", runs: int = 5, warm_up: int = 1
) -> Timing:
    """Call `function` `warm_up` times, then time `runs` calls.

    Raises:
        ValueError: `runs` is less than one.
    """
    if runs < 1:
        raise ValueError(f"expected at least one run, found {runs}")
    device = torch.device(device)
    for _ in range(warm_up):
        function()
    _wait(device)
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats(device)
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        function()
        _wait(device)
        seconds.append(time.perf_counter() - start)
    return Timing(statistics.median(seconds), min(seconds), max(seconds), runs, peak_memory(device))


def peak_memory(device: torch.device | str = "cpu") -> int:
    """Peak memory, bytes: CUDA's since it was reset, or this process's resident memory (0 if unknown)."""
    device = torch.device(device)
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device)
    return peak_resident_memory()


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
