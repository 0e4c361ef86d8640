"""A page that shows a run while this process fits it: in a process of its own, so that the fit computes as without."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from neural_strands.viewer.server import check_installed

STANDARD_ERROR = 2
PATIENCE = 10.0
"""Seconds that the process may take to end by itself."""


@contextmanager
def page_beside(run: Path) -> Iterator[None]:
    """Show a run, which may have yet to begin, until the block ends; the page's address goes to standard error.

    Raises:
        InputError: viser is not installed.
    """
    check_installed()
    command = [sys.executable, "-m", "neural_strands", "view", str(run), "--wait"]
    process = subprocess.Popen(command, stdout=STANDARD_ERROR)
    try:
        yield
    finally:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            # The page only reads the run, so nothing is lost.
            process.kill()
            process.wait()
