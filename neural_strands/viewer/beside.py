"""A page that shows a run while this process fits it; it has its own process, so that it does not affect the fit."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from neural_strands.viewer.server import check_installed

STANDARD_ERROR = 2
PATIENCE = 10.0
"""Time that the process may take to end by itself, seconds."""


@contextmanager
def page_beside(run: Path) -> Iterator[None]:
    """Show a run, which need not have started yet, until the block ends; the page's address goes to standard error.

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
            # Killing it loses nothing, because the page only reads the run.
            process.kill()
            process.wait()
