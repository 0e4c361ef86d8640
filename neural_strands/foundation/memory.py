"""Keeps freed memory that will be needed again soon."""

import ctypes
import sys

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`, numbered as in malloc.h."""

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
