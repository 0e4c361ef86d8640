"""Hair that blows on the page, as fast as the machine computes it."""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch

from neural_strands.editing.edit_list import HairMotion, hair_motion
from neural_strands.editing.settings import Wind
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands
from neural_strands.model.renderer import HairRenderer
from neural_strands.viewer.page import Page
from neural_strands.viewer.scene import Scene

log = logging.getLogger(__name__)

POINTS = 34
"""Points of a strand while it moves, if it has more."""
SECONDS_A_MOMENT = 0.1
"""Least time between two moments: no more are computed than are drawn."""


class WindPlayer:
    """A thread that moves the hair of a page, edited or not, until it is stopped or no wind is among the edits."""

    def __init__(self, page: Page, ended: Callable[[], None]) -> None:
        """Do nothing yet.

        Args:
            page: whose hair moves.
            ended: called when the hair comes to rest, however that comes about.
        """
        self._page, self._ended = page, ended
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def play(self) -> None:
        """Let the wind blow that is among the page's edits; one that blows already goes on with what has changed.

        Raises:
            InputError: the hair has no model, or no wind is among its edits.
        """
        Blowing.of(self._page.scene)
        if self._thread is not None and self._thread.is_alive() and not self._stopped.is_set():
            return
        self.stop()
        self._stopped.clear()
        self._thread = threading.Thread(target=self._run, name="viewer-wind", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Show the hair at rest again."""
        self._stopped.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        began = time.monotonic()
        blowing = None
        try:
            while not self._stopped.is_set():
                begin = time.monotonic()
                if blowing is None or blowing.scene is not self._page.scene:
                    blowing = Blowing.of(self._page.scene)
                self._page.show_moment(blowing.at(begin - began))
                self._stopped.wait(max(SECONDS_A_MOMENT - (time.monotonic() - begin), 0.0))
        except InputError as error:
            # The wind has been undone.
            log.info("%s", error)
        finally:
            self._page.show_moment(None)
            self._ended()


@dataclass(frozen=True)
class Blowing:
    """The hair of a scene in the wind that is among its edits.

    Attributes:
        scene: whose hair.
        renderer: of the scene.
        thin: the hair at rest, with few points.
        motion: moves it.
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
        # A simulation would not keep up.
        quick = [replace(edit, simulate=False) if isinstance(edit, Wind) else edit for edit in scene.edits]
        motion = hair_motion(replace(scene.hair, strands=thin), quick)
        if motion is None:
            raise InputError("Wind: expected wind among the edits, found none; add it first.")
        return cls(scene, scene.renderer, thin, motion)

    def at(self, seconds: float) -> HairRenderer:
        """The hair as it lies so many seconds after the wind has begun to rise."""
        return self.renderer.showing(replace(self.thin, points=self.motion.at(seconds)))


def thinned(strands: Strands, points: int = POINTS) -> Strands:
    """Strands of fewer points, which are some of theirs."""
    count = strands.points_per_strand
    kept = torch.linspace(0, count - 1, min(points, count), device=strands.points.device).round().long()
    width = None if strands.width is None else strands.width[:, kept]
    return replace(strands, points=strands.points[:, kept], width=width, t=strands.parameters()[:, kept])
