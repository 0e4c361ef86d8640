"""How much longer an image step and a static frame take beside busy processes than their fair share of the cores.

    python benchmarks/speed/busy.py [--busy 2] [--threads 1 2]

The fair share: all threads that want to run, ours and one for each busy process, get the same share of the processor
cores, and none more than one core. So if `b` processes are busy on `c` cores, each of our `t` threads gets
`min(1, c / (b + t))` of a core, where it gets `min(1, c / t)` alone. Work that takes `s` seconds of wall time alone
with `t` threads would then take

    fair = s * min(1, c / t) / min(1, c / (b + t))

and the ratio that is printed is the wall time beside the busy processes over that. It is 1 if nothing is lost but the
cores themselves, and more if threads wait for each other, or if the caches and the memory are shared. The aim is at
most 1.5 beside two busy processes.

The cores are those that this process may use (`taskset` restricts them, for the busy processes too), which should be
quiet otherwise. The image step is that of fit_step.py, the frame that of render.py, both on the CPU. Figures are
medians. What they take alone is measured before and after, and the mean counts. If both differ much, the machine was
not quiet. A frame that is shorter than a turn of the scheduler may take less than its fair time.
"""

import contextlib
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import tyro

from neural_strands.foundation.memory import keep_freed_memory
from neural_strands.foundation.threads import sleep_when_idle


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    busy: int = 2
    """Number of busy processes."""
    threads: tuple[int, ...] = (1, 2)
    """Numbers of our threads, one after the other."""
    preset: Literal["demo", "fast", "paper"] = "fast"
    """Preset of the fit."""
    resolution: int = 512
    """Side of the fit's photographs, pixels."""
    strands: int = 10_000
    """Strands of the frame."""
    size: int = 256
    """Side of the frame, pixels."""
    runs: int = 10
    """Measured steps and frames, each."""


@dataclass(frozen=True)
class Load:
    """What wants to run.

    Attributes:
        cores: number of processor cores.
        busy: number of busy processes, of one thread each.
        threads: number of our threads.
    """

    cores: int
    busy: int
    threads: int

    def share(self) -> float:
        """Share of a core that a thread gets if all get the same."""
        return min(1.0, self.cores / (self.busy + self.threads))

    def fair_seconds(self, alone: float) -> float:
        """Wall time that work should take beside the busy processes, from what it takes alone."""
        return alone * Load(self.cores, 0, self.threads).share() / self.share()


@contextlib.contextmanager
def busy_processes(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run so many processes that only compute, within the block."""
    processes: list[subprocess.Popen[bytes]] = []
    try:
        for _ in range(count):
            processes.append(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


@contextlib.contextmanager
def works(arguments: Arguments) -> Iterator[dict[str, Callable[[], list[float]]]]:
    """An image step and a static frame; each returns the seconds of some runs."""
    import torch
    from fit_step import stand_in, step_seconds
    from render import Arguments as Rendering
    from render import hair_model, view

    from neural_strands.model.renderer import HairRenderer

    cpu = torch.device("cpu")
    model = hair_model(arguments.strands, Rendering(), cpu)
    renderer, camera = HairRenderer.of(model), view(model, arguments.size)

    def frame_seconds() -> list[float]:
        seconds = []
        for _ in range(arguments.runs + 2):
            began = time.perf_counter()
            renderer.render(camera)
            seconds.append(time.perf_counter() - began)
        return seconds[2:]

    with stand_in(arguments.preset, cpu, arguments.resolution) as (data, config):
        yield {
            "image step": lambda: step_seconds(data, config, 0.0, arguments.runs),
            "static frame": frame_seconds,
        }


def measured(arguments: Arguments) -> list[tuple[object, ...]]:
    """Number of threads, work, milliseconds alone before and after, beside busy processes, fair ones, and the ratio."""
    import torch

    rows: list[tuple[object, ...]] = []
    with works(arguments) as found:
        for threads in arguments.threads:
            torch.set_num_threads(threads)
            load = Load(len(os.sched_getaffinity(0)), arguments.busy, threads)
            before = {what: statistics.median(run()) for what, run in found.items()}
            with busy_processes(arguments.busy):
                beside = {what: statistics.median(run()) for what, run in found.items()}
            after = {what: statistics.median(run()) for what, run in found.items()}
            for what in found:
                fair = load.fair_seconds(0.5 * (before[what] + after[what]))
                numbers = (before[what], after[what], beside[what], fair)
                rows.append((what, threads, *(1e3 * number for number in numbers), f"{beside[what] / fair:.2f}"))
    return rows


def main(arguments: Arguments) -> None:
    """Measure and print the table."""
    sleep_when_idle()  # as the command line does, and before torch is loaded
    keep_freed_memory()
    from beside import table

    heads = ("wall ms, median", "threads", "alone", "alone, later", f"beside {arguments.busy}", "fair", "of fair")
    rows = measured(arguments)
    sys.stdout.write(f"{len(os.sched_getaffinity(0))} cores, {arguments.busy} busy processes\n{table(heads, rows)}\n")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
