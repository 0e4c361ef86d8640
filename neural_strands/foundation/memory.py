"""Memory that is freed and wanted again at once."""

import ctypes
import sys

TRIM_THRESHOLD, MMAP_THRESHOLD = -1, -3
"""Parameters of glibc's `mallopt`, as malloc.h numbers them."""

KEPT = 1 << 30
"""Bytes at the heap's end that stay with the process, and the least request that is mapped by itself."""


def keep_freed_memory() -> bool:
    """Let the C library keep large blocks that are freed, for the process's whole life; for programs, not libraries.

    Images and activations of some megabytes come and go many times a frame. By default glibc gives each back to the
    system and asks for it again, and the kernel clears every page anew (docs/experiments/speed.md has the cost).

    Returns:
        Whether the C library is one that can be told so.
    """
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    # Other C libraries need not have it.
    return mallopt is not None and all(mallopt(name, KEPT) == 1 for name in (TRIM_THRESHOLD, MMAP_THRESHOLD))
