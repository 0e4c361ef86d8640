"""Plays hair in the wind on the page, as fast as the machine computes it."""

import logging
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from neural_strands.editing.edit_list import HairMotion, hair_motion
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands
from neural_strands.model.renderer import HairRenderer
from neural_strands.viewer.page import Page
from neural_strands.viewer.scene import Scene

log = logging.getLogger(__name__)

POINTS = 34
"""Largest number of points per strand while it moves."""
SECONDS_A_MOMENT = 0.1
"""Least time between two states, seconds, so that no more are computed than drawn."""
SIMULATED_STEP = 1 / 24
"""Largest simulated time between two states, seconds."""


class WindPlayer:
    """A thread that moves the hair of a page, edited or not, until it is stopped or no wind is among the edits."""

    def __init__(self, page: Page, ended: Callable[[], None]) -> None:
        """Do nothing yet.

        Args:
            page: the page whose hair moves.
            ended: called when the hair comes to rest, for whatever reason.
        """
        self._page, self._ended = page, ended
        self._lock = threading.RLock()
        self._run: _Run | None = None

    def play(self) -> None:
        """Play the wind among the page's edits; if it is already playing, it continues with the changed settings.

        Raises:
            InputError: the hair has no model, or no wind is among its edits.
        """
        with self._lock:
            if self._run is not None and not self._run.stopped.is_set():
                return
        self.stop()
        blowing = Blowing.of(self._page.scene)
        # Do slow first-time work now, while the page shows a notice.
        blowing.motion.at(0.0)
        with self._lock:
            if self._run is None:
                self._run = _Run()
                self._run.thread = threading.Thread(
                    target=self._play, args=(self._run, blowing), name="viewer-wind", daemon=True
                )
                self._run.thread.start()

    def stop(self) -> None:
        """Show the hair at rest again."""
        with self._lock:
            run = self._run
        if run is not None:
            run.stopped.set()
            if run.thread is not threading.current_thread():
                run.thread.join()

    def _play(self, run: "_Run", blowing: "Blowing") -> None:
        began, seconds = time.monotonic(), 0.0
        try:
            while not run.stopped.is_set():
                begin = time.monotonic()
                if blowing.scene is not self._page.scene:
                    blowing = Blowing.of(self._page.scene)
                seconds = min(begin - began, seconds + blowing.longest_step)
                self._page.show_moment(blowing.at(seconds))
                run.stopped.wait(max(SECONDS_A_MOMENT - (time.monotonic() - begin), 0.0))
        except InputError as error:
            # The wind may have been undone meanwhile.
            log.info("%s", error)
        finally:
            # A new call of `play` waits until this one has ended.
            with self._lock:
                self._run = None
                try:
                    self._page.show_moment(None)
                finally:
                    self._ended()


class _Run:
    """One playback: its thread, and whether it should end."""

    thread: threading.Thread

    def __init__(self) -> None:
        self.stopped = threading.Event()


@dataclass(frozen=True)
class Blowing:
    """The hair of a scene, moved by the wind among its edits.

    Attributes:
        scene: the scene.
        renderer: renderer of the scene.
        thin: the hair at rest, with fewer points.
        motion: motion of that hair.
    """

    scene: Scene
    renderer: HairRenderer
    thin: Strands
    motion: HairMotion

    @classmethod
    def of(cls, scene: Scene) -> "Blowing":
        """Prepare.

        Raises:
            InputError: the hair has no model, or no wind is among its edits.
        """
        if scene.renderer is None or scene.hair is None:
            raise InputError("Wind: expected hair with a model that renders it, found none; open a run.")
        thin = thinned(scene.hair.strands)
        motion = hair_motion(replace(scene.hair, strands=thin), scene.edits)
        if motion is None:
            raise InputError("Wind: expected wind among the edits, found none; add it first.")
        return cls(scene, scene.renderer, thin, motion)

    @property
    def longest_step(self) -> float:
        """Longest time between two states, seconds; a simulation that cannot keep up plays in slow motion."""
        return SIMULATED_STEP if self.motion.wind.simulate else math.inf

    def at(self, seconds: float) -> HairRenderer:
        """A renderer of the hair at a time after the wind began to rise."""
        return self.renderer.showing(replace(self.thin, points=self.motion.at(seconds)))


def thinned(strands: Strands, points: int = POINTS) -> Strands:
    """Keep a subset of the points of each strand."""
    count = strands.points_per_strand
    kept = torch.linspace(0, count - 1, min(points, count), device=strands.points.device).round().long()
    width = None if strands.width is None else strands.width[:, kept]
    return replace(strands, points=strands.points[:, kept], width=width, t=strands.parameters()[:, kept])
