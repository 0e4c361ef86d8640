"""Timing of a function: median of several runs, the device waited for, peak memory beside it."""

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Timing:
    """How long a function takes.

    Attributes:
        median: seconds.
        fastest: seconds; the figure to trust on a machine that others use.
        slowest: seconds.
        runs: how many were measured.
        peak_bytes: on CUDA the most memory allocated during the runs; on CPU the most that the process has ever held
            (0 where the platform does not tell).
    """

    median: float
    fastest: float
    slowest: float
    runs: int
    peak_bytes: int


def time_function(
    function: Callable[[], object], device: torch.device | str = "cpu", runs: int = 5, warm_up: int = 1
) -> Timing:
    """Call `function` a few times unmeasured, then `runs` times with the clock on.

    Raises:
        ValueError: fewer than one run.
    """
    if runs < 1:
        raise ValueError(f"expected at least one run, came {runs}")
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
    """Bytes: CUDA's peak since it was reset, or the peak of this process's resident memory (0 where unknown)."""
    device = torch.device(device)
    if device.type == "cuda":
        return torch.cuda.max_memory_allocated(device)
    try:
        import resource
    except ImportError:  # Windows
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _wait(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)
