"""Hair that blows on the page, as fast as the machine computes it."""

import threading
import time
from dataclasses import replace

import torch

from neural_strands.editing.edit_list import hair_motion
from neural_strands.editing.hair import Hair
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.strands import Strands
from neural_strands.viewer.page import Page

POINTS = 34
"""Points of a strand while it moves, if it has more."""
SECONDS_A_MOMENT = 0.1
"""Least time between two moments: no more are computed than are drawn."""


class WindPlayer:
    """A thread that moves the hair of a page until it is stopped, or the hair is changed."""

    def __init__(self, page: Page) -> None:
        """Do nothing yet.

        Args:
            page: whose hair moves.
        """
        self._page = page
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def play(self) -> None:
        """Let the wind blow that is among the page's edits.

        Raises:
            InputError: the hair has no model, or no wind is among its edits.
        """
        self.stop()
        scene = self._page.scene
        if scene.renderer is None or scene.hair is None:
            raise InputError("Wind: expected hair with a model that renders it, found none; open a run.")
        thin = thinned(scene.hair.strands)
        motion = hair_motion(Hair(thin, scene.hair.model), scene.edits)
        if motion is None:
            raise InputError("Wind: expected wind among the edits, found none; add it first.")
        renderer = scene.renderer

        def run() -> None:
            began = time.monotonic()
            while not self._stopped.is_set() and self._page.scene is scene:
                begin = time.monotonic()
                moment = replace(thin, points=motion.at((begin - began) % max(motion.wind.seconds, 1.0)))
                self._page.show_moment(renderer.showing(moment))
                self._stopped.wait(max(SECONDS_A_MOMENT - (time.monotonic() - begin), 0.0))
            self._page.show_moment(None)

        self._stopped.clear()
        self._thread = threading.Thread(target=run, name="viewer-wind", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Show the hair at rest again."""
        if self._thread is not None:
            self._stopped.set()
            self._thread.join()
            self._thread = None


def thinned(strands: Strands, points: int = POINTS) -> Strands:
    """Strands of fewer points, which are some of theirs."""
    count = strands.points_per_strand
    kept = torch.linspace(0, count - 1, min(points, count), device=strands.points.device).round().long()
    width = None if strands.width is None else strands.width[:, kept]
    return replace(strands, points=strands.points[:, kept], width=width, t=strands.parameters()[:, kept])
