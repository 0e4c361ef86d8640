"""A thread that draws the newest request of every browser: quickly while it changes, finely once it rests."""

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from neural_strands.viewer.pace import Pace

log = logging.getLogger(__name__)

T = TypeVar("T")

SECONDS_A_FRAME = 0.12
"""Target time per picture while the camera moves: slightly more than eight per second, for at least five after transfer
and display."""
REST_SECONDS = (0.25, 0.6)
"""Time that a request must stay the newest before it is drawn at each of the finer sizes, seconds."""
FINER = (512, 1024)
"""Longer sides of the finer pictures, pixels."""


@dataclass
class _Wish(Generic[T]):
    """The newest request of one browser, and its progress.

    Attributes:
        request: the request.
        asked: time of the request, seconds of the monotonic clock.
        level: number of pictures drawn so far, the quick one included.
    """

    request: T
    asked: float
    level: int = 0


class RenderLoop(Generic[T]):
    """Draws requests one at a time; only the newest of each browser counts.

    `draw` takes a request and the number of pixels along the longer side; it delivers the picture itself.
    """

    def __init__(self, draw: Callable[[int, T, int], None], finer: tuple[int, ...] = FINER) -> None:
        """Start the thread.

        Args:
            draw: called in the thread with the browser, its request and the size.
            finer: sizes of the finer pictures of a request that rests, at least one; no picture is larger than these.
        """
        self._draw = draw
        self._finer = finer
        self._wishes: dict[int, _Wish[T]] = {}
        # Time of each browser's last picture, so that they take turns.
        self._served: dict[int, float] = {}
        self._pace = Pace(SECONDS_A_FRAME)
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="viewer-render", daemon=True)
        self._thread.start()

    def ask(self, browser: int, request: T) -> None:
        """Draw a request for a browser, replacing its previous one."""
        with self._changed:
            self._wishes[browser] = _Wish(request, time.monotonic())
            self._changed.notify()

    def forget(self, browser: int) -> None:
        """Drop the requests of a browser that has disconnected."""
        with self._changed:
            self._wishes.pop(browser, None)
            self._served.pop(browser, None)

    def stop(self) -> None:
        """End the thread after the current picture."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while (due := self._wait()) is not None:
            browser, wish = due
            quick = wish.level == 0
            size = min(self._pace.size, max(self._finer))
            if not quick:
                size = max(self._finer[wish.level - 1], size)
            begin = time.monotonic()
            try:
                self._draw(browser, wish.request, size)
            except Exception:
                # A failing request must not stop the pictures of all browsers.
                log.exception("a picture could not be drawn")
            if quick:
                self._pace.took(time.monotonic() - begin)
            with self._changed:
                wish.level += 1
                if browser in self._wishes:
                    self._served[browser] = time.monotonic()

    def _wait(self) -> tuple[int, _Wish[T]] | None:
        """Wait for the next picture that is due; None when the loop ends."""
        with self._changed:
            while not self._ended:
                now = time.monotonic()
                waiting = [(*self._due(wish), browser) for browser, wish in self._wishes.items()]
                ready = [
                    (level, self._served.get(browser, 0.0), browser) for when, level, browser in waiting if when <= now
                ]
                if ready:
                    browser = min(ready)[2]
                    return browser, self._wishes[browser]
                soonest = min((when for when, _, _ in waiting), default=math.inf)
                self._changed.wait(None if soonest == math.inf else soonest - now)
        return None

    def _due(self, wish: _Wish[T]) -> tuple[float, int]:
        """Time at which a request's next picture is due, and its level; quick pictures of all browsers come first."""
        if wish.level == 0:
            return wish.asked, 0
        if wish.level > len(self._finer):
            return math.inf, wish.level
        return wish.asked + REST_SECONDS[min(wish.level, len(REST_SECONDS)) - 1], wish.level
