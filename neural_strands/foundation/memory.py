"""The memory of this process: the most it took, how much it may still take, and keeping what is needed again soon."""

import ctypes
import sys
from contextlib import suppress
from pathlib import Path

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`, numbered as in malloc.h."""

CONTAINER = Path("/sys/fs/cgroup")
"""Where Linux says what a container may use."""
KEPT = 1 << 30
"""Free bytes at the end of the heap that the process keeps, and smallest request that is mapped separately."""


def keep_freed_memory() -> bool:
    """Let the C library keep large freed blocks for the life of the process; call it in programs, not libraries.

    Images and activations of some megabytes are allocated and freed many times per frame. By default glibc returns each
    to the system and requests it again, and the kernel clears every page (docs/experiments/speed.md has the cost).

    Returns:
        Whether the C library supports this.
    """
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    # Other C libraries may lack it.
    return mallopt is not None and all(mallopt(name, KEPT) == 1 for name in (TRIM_THRESHOLD, MMAP_THRESHOLD))


def free_memory() -> int | None:
    """Bytes that this process may still take, as far as the system says; None if it does not say.

    Linux reports what is available to all processes; a container and a limit on the process's addresses may allow less.
    """
    try:
        told = Path("/proc/meminfo").read_text()
    except OSError:
        return None
    available, swap = (_first_number(told.partition(name)[2]) for name in ("MemAvailable:", "SwapFree:"))
    bounds = [] if available is None else [1024 * (available + (swap or 0))]
    with suppress(OSError):
        most = _first_number((CONTAINER / "memory.max").read_text())
        taken = _first_number((CONTAINER / "memory.current").read_text())
        if most is not None and taken is not None:
            bounds.append(most - taken)
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY:
        pages = _first_number(Path("/proc/self/statm").read_text())
        bounds.append(limit - (pages or 0) * resource.getpagesize())
    return max(0, min(bounds)) if bounds else None


def peak_resident_memory() -> int:
    """The most bytes of memory that this process has had so far; 0 if the system does not report it."""
    with suppress(OSError):
        # Linux's getrusage also counts the process that started this one, up to the start of this program.
        peak = _first_number(Path("/proc/self/status").read_text().partition("VmHWM:")[2])
        if peak is not None:
            return 1024 * peak
    try:
        import resource
    except ImportError:  # Windows
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return unit * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _first_number(text: str) -> int | None:
    """The first word of a text, if it is a number; None for "max", by which Linux means no limit."""
    word = text.split(maxsplit=1)[:1]
    return int(word[0]) if word and word[0].isdecimal() else None
