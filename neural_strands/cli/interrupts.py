"""Ctrl-C while the program is still loading, and a request to end (SIGTERM) as if it were Ctrl-C."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 and the number of SIGINT."""


@contextmanager
def interruptible_loading(sentence: str) -> Iterator[Callable[[], None]]:
    """Within the block, Ctrl-C ends the program with `sentence` at once while modules are being loaded.

    A KeyboardInterrupt can be lost inside an import, and inside torch's initialisation it aborts the process with a
    dump. Nothing has been begun by then that would have to be kept. Once the function that is yielded has been called,
    only torch's own import counts as loading, and Ctrl-C is the usual KeyboardInterrupt otherwise. Where something
    else handles or ignores the signal, that stays.
    """
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield lambda: None
        return
    loading = True

    def loaded() -> None:
        nonlocal loading
        loading = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        torch = getattr(sys.modules.get("torch"), "__spec__", None)
        if loading or getattr(torch, "_initializing", False):
            os.write(2, f"{sentence}\n".encode())
            os._exit(INTERRUPTED)
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield loaded
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def ends_as_interrupted() -> Iterator[None]:
    """Within the block, SIGTERM does what Ctrl-C does: whatever would be kept then is kept.

    Batch systems send it some time before they kill a job. Where something handles or ignores either signal, as a shell
    lets its background jobs ignore Ctrl-C, that stays.
    """
    in_main = threading.current_thread() is threading.main_thread()
    free = in_main and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if not free or not callable(signal.getsignal(signal.SIGINT)):
        yield
        return
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
