"""Serves a path as a page, which follows a run while it is being fitted."""

import logging
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from neural_strands.foundation.errors import InputError
from neural_strands.runs.newest_model import StateFile, newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.notices import complain
from neural_strands.viewer.open_scene import kind_of, open_capture, open_edited, open_groom, open_model, open_run
from neural_strands.viewer.page import Page
from neural_strands.viewer.panels.tabs import Tabs
from neural_strands.viewer.render_loop import FINER
from neural_strands.viewer.scene import Scene

if TYPE_CHECKING:
    import viser

log = logging.getLogger(__name__)

POLL_SECONDS = 2.0
"""Interval at which a run is checked for a newer state, seconds."""
PREPARE_SECONDS = 5.0
"""Time for the first pictures before light and the distance to the head are prepared for edits, seconds."""


class ServedPage:
    """A page together with the path that it shows."""

    def __init__(
        self, server: "viser.ViserServer", path: Path, device: torch.device, finer: tuple[int, ...] = FINER
    ) -> None:
        """Open a path and show it.

        Args:
            server: viser's.
            path: a run, a model, edited hair, a groom or a capture.
            device: where to render.
            finer: sizes of the pictures once the camera rests (`RenderLoop`).

        Raises:
            InputError: the path cannot be shown, or is damaged.
        """
        self._path, self._device = path, device
        self._kind = kind_of(path)
        self._state = newest_state(RunFolder(path)) if self._kind == "run" else None
        self.page = Page(server, self._open(self._state), finer)
        self._tabs = Tabs(self.page)
        # Prepare edits while the user is still looking around, so that the first edit is as fast as the others.
        self._closed = threading.Event()
        self._preparing = threading.Thread(target=self._prepare, name="viewer-light", daemon=True)
        self._preparing.start()

    def close(self) -> None:
        """End the page's threads; the server keeps running."""
        self._closed.set()
        self._preparing.join()
        self.page.close()

    def follow(self) -> None:
        """Show a run's newest states as the fit writes them; returns only when interrupted."""
        while True:
            time.sleep(POLL_SECONDS)
            self.refresh()

    def refresh(self) -> bool:
        """Show the newest state of a run if there is a newer one; returns whether there was.

        A state that cannot be read is skipped, because the fit will write another.
        """
        state = newest_state(RunFolder(self._path)) if self._kind == "run" else None
        try:
            self._tabs.follow()
            if state is None or state == self._state:
                return False
            self._state, before = state, self.page.scene
            self.page.show(self._open(state))
        except InputError as error:
            self._complain(error)
            return False
        if _parts(self.page.scene) == _parts(before):
            self._tabs.update()
        else:
            self._tabs = Tabs(self.page)
        return True

    def _prepare(self) -> None:
        if self._closed.wait(PREPARE_SECONDS):
            return
        scene = self.page.scene
        if scene.unedited is not None:
            scene.unedited.prepare_edits()
        if scene.fitted is not None and not self._closed.is_set():
            _ = scene.fitted.body_grid

    def _complain(self, error: InputError) -> None:
        log.warning("%s", error)
        for client in self.page.server.get_clients().values():
            complain(client, error)

    def _open(self, state: StateFile | None) -> Scene:
        if self._kind == "run":
            return open_run(self._path, state, self._device)
        if self._kind == "edited":
            return open_edited(self._path, self._device)
        if self._kind == "model":
            return open_model(self._path, self._device)
        return open_groom(self._path) if self._kind == "groom" else open_capture(self._path)


def _parts(scene: Scene) -> list[bool]:
    """Which parts a scene has, and the panel therefore has controls for."""
    parts = (scene.strands, scene.renderer, scene.head, scene.segments, scene.photographs)
    return [part is not None for part in parts]
