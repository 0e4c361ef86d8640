"""Sentences on standard error, and standard output that is closed, full, or whose reader has left."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from neural_strands.foundation.errors import InputError, reason


def say(sentence: str) -> None:
    """Report one sentence on standard error."""
    sys.stderr.write(f"{sentence}\n")
    sys.stderr.flush()


def print_json(document: Any, indent: int | None = None) -> None:
    """Print one JSON document on standard output: the answer of a command with `--json`."""
    sys.stdout.write(json.dumps(document, indent=indent) + "\n")


class ReaderGoneError(Exception):
    """Nobody reads standard output any more, as in `neural-strands --help | head -3`."""


class _GuardedOutput:
    """A stream whose failures to write are one sentence, or quiet where its reader has left."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with _told():
            return self._stream.write(text)

    def flush(self) -> None:
        with _told():
            self._stream.flush()


@contextmanager
def guarded_output() -> Iterator[None]:
    """Within the block, and at its end, standard output that cannot be written ends in a sentence or quietly.

    A process that was started with closed streams (`>&-`) gets streams that lead nowhere.

    Raises:
        InputError: standard output cannot be written, because the disk is full for instance.
        ReaderGoneError: nobody reads it any more.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 - open for good
    stream = sys.stdout
    guarded: Any = _GuardedOutput(stream)
    sys.stdout = guarded
    try:
        yield
    finally:
        sys.stdout = stream
        guarded.flush()


@contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError as error:
        _drop_output()
        raise ReaderGoneError from error
    except OSError as error:
        _drop_output()
        raise InputError(f"standard output: cannot be written ({reason(error)}); free disk space.") from error


def _drop_output() -> None:
    """Lead standard output nowhere, so that Python does not complain at its end about what is left to be written."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
