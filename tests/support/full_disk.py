"""A disk that fills up: the system refuses to let any file grow."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def smallest_files(most: int) -> Iterator[None]:
    """Within the block, writing more than `most` bytes to a file fails, as on a full disk (EFBIG instead of ENOSPC)."""
    resource = pytest.importorskip("resource", reason="only POSIX limits the size of files")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
