"""Defers Ctrl-C, so that an optimisation step is taken either completely or not at all."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def deferred_interrupt() -> Iterator[None]:
    """Let the first Ctrl-C (SIGINT) within the block take effect at its end; a second one takes effect at once.

    The previous handler handles it then. Nothing changes outside the main thread, where Python handles no signals, or
    if the signal is ignored.
    """
    earlier = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(earlier):
        yield
        return
    waiting: list[FrameType | None] = []

    def keep(number: int, frame: FrameType | None) -> None:
        if waiting:
            earlier(number, frame)
        waiting.append(frame)

    signal.signal(signal.SIGINT, keep)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, earlier)
    if waiting:
        earlier(signal.SIGINT, waiting[0])


def whole_steps(steps: Iterator[T]) -> Iterator[T]:
    """Iterate over `steps`; a Ctrl-C during a step is deferred to the end of that step."""
    while True:
        with deferred_interrupt():
            try:
                step = next(steps)
            except StopIteration:
                return
        yield step
