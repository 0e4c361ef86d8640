"""One damaged file given to one reader, and what it cost."""

import contextlib
import gc
import os
import signal
import threading
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from neural_strands.foundation.errors import InputError

SECONDS = 10.0
"""A reader that takes more processor time than this counts as hanging, seconds."""
STUCK = 60.0
"""A reader that has not returned after so many seconds counts as hanging, however busy the machine is."""
TIMES_THE_FILE = 10
"""To refuse a file, a reader may use this many times its size in memory, and `SLACK`."""
SLACK = 32 * 2**20
"""Bytes that any file may cost, for libraries that are loaded late and for what they keep."""
LONGEST_SENTENCE = 1000


class HangError(BaseException):
    """A reader took too long. Not an `Exception`, so that no reader mistakes it for damage."""


@dataclass(frozen=True)
class Outcome:
    """What became of one input.

    Attributes:
        kind: "read", "refused", or a fault: "crash", "hang", "greedy" (memory), "sentence" (a message not fit to read).
        detail: the sentence, or what went wrong.
        seconds: of a processor.
        peak: bytes it took at most, beyond what was taken before.
    """

    kind: str
    detail: str
    seconds: float
    peak: int

    @property
    def is_fault(self) -> bool:
        """Whether the reader has a bug."""
        return self.kind not in ("read", "refused")


def give(read: Callable[[Path], object], path: Path) -> Outcome:
    """Read a file; whatever happens is an outcome."""
    kind, detail = "read", ""
    gc_was_on = gc.isenabled()
    gc.disable()
    resident = _reset_resident()
    tracemalloc.start()
    began = _processor_seconds()
    try:
        with _alarm(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)
    except InputError as error:
        kind, detail = "refused", str(error)
    except HangError:
        kind, detail = "hang", f"not back after {STUCK:g} s"
    except Exception as error:
        kind, detail = "crash", f"{type(error).__name__}: {error}"[:LONGEST_SENTENCE] + _where(error)
    seconds = _processor_seconds() - began
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    if resident is not None:
        peak = max(peak, _resident("VmHWM") - resident)
    if gc_was_on:
        gc.enable()
    if seconds > SECONDS:
        kind, detail = "hang", f"{seconds:.1f} s: {detail}"
    if kind == "refused" and (len(detail) > LONGEST_SENTENCE + len(str(path)) or not detail.isprintable()):
        kind = "sentence"
    if kind == "refused" and peak > TIMES_THE_FILE * path.stat().st_size + SLACK:
        kind, detail = "greedy", f"{peak} bytes for a refused file of {path.stat().st_size}: {detail}"
    return Outcome(kind, detail, seconds, peak)


def _processor_seconds() -> float:
    """Processor seconds of this process and of those that it has started."""
    return sum(os.times()[:4])


def _where(error: Exception) -> str:
    """File and line of the innermost frames."""
    places, frame = [], error.__traceback__
    while frame is not None:
        places.append(f"{Path(frame.tb_frame.f_code.co_filename).name}:{frame.tb_lineno}")
        frame = frame.tb_next
    return f" at {' < '.join(reversed(places[-4:]))}"


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    """Interrupt the block after `STUCK` seconds, where the system can."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(number: int, frame: FrameType | None) -> None:
        raise HangError

    earlier = signal.signal(signal.SIGALRM, ring)
    # An alarm that was set before, for instance by a test runner, is kept.
    remaining, _ = signal.setitimer(signal.ITIMER_REAL, STUCK)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, earlier)
        signal.setitimer(signal.ITIMER_REAL, remaining)


def _reset_resident() -> int | None:
    """Reset Linux's record of the process's largest size, and return its size now; None on other systems."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return None
    return _resident("VmRSS")


def _resident(name: str) -> int:
    """A size of this process in bytes, as Linux reports it."""
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition(f"{name}:")[2].split(maxsplit=1)[0])
