"""Workers: separate programs that may run in another Python, which has a package that conflicts with this one's.

A worker reads its request, a JSON document, from standard input, and answers with lines on standard output.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

from neural_strands.foundation.errors import InputError, reason

TRACE = ("***", "PC: @", "@ ")
"""How lines of a stack trace begin that glog writes where a process aborts."""
LONGEST_COMPLAINT = 300
"""Largest number of characters of a program's last line that are repeated."""


@dataclass(frozen=True)
class Worker:
    """A running worker.

    Attributes:
        python: its interpreter.
        process: its process.
        complaints: what it writes to standard error.
    """

    python: str
    process: subprocess.Popen[str]
    complaints: IO[str]

    def answers(self) -> Iterator[str]:
        """The lines that it prints, as they arrive, until it ends."""
        assert self.process.stdout is not None
        yield from self.process.stdout

    def status(self) -> int:
        """Wait for its end, dropping further answers, and return its exit status."""
        for _ in self.answers():
            pass
        return self.process.wait()

    def last_words(self) -> str:
        """Wait for its end, and return the last line that it wrote to standard error, or else its exit status.

        A library that aborts the process writes the reason first and a stack trace after it, which is left out.
        """
        status = self.status()
        self.complaints.seek(0)
        said = [line for line in self.complaints.read().splitlines() if not line.lstrip().startswith(TRACE)]
        return last_line("\n".join(said).replace("what():", ""), f"exit status {status}")


def last_line(complaints: str, otherwise: str) -> str:
    """The last line of what a program wrote to standard error, cut if it is long; `otherwise` if it wrote nothing."""
    lines = complaints.strip().splitlines() or [otherwise]
    return lines[-1][:LONGEST_COMPLAINT]


@contextmanager
def started_worker(
    python: Path | None, program: Path, request: object, package: str, isolated: bool = True
) -> Iterator[Worker]:
    """Start a worker, and wait for its end when the block ends; it is killed if the block fails or is interrupted.

    Args:
        python: its interpreter; this one if None.
        program: the worker's file.
        request: JSON values, which it receives.
        package: what the interpreter should have, for the message if it does not start.
        isolated: whether it is kept from the paths and packages of this environment and its user; if not, it only does
            not see the program's folder.

    Raises:
        InputError: the interpreter does not start.
    """
    interpreter = sys.executable if python is None else str(python)
    with (
        TemporaryFile("w+", encoding="utf-8") as asked,
        TemporaryFile("w+", encoding="utf-8", errors="replace") as complaints,
    ):
        json.dump(request, asked)
        asked.seek(0)
        try:
            process = subprocess.Popen(
                [interpreter, "-I" if isolated else "-P", str(program)],
                stdin=asked,
                stdout=subprocess.PIPE,
                stderr=complaints,
                encoding="utf-8",
                errors="replace",
            )
        except OSError as error:
            raise InputError(
                f"{interpreter}: expected a Python with {package}, found one that does not start ({reason(error)}); "
                "name another."
            ) from error
        with process:
            try:
                yield Worker(interpreter, process, complaints)
            except BaseException:
                process.kill()
                raise
