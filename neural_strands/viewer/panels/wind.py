"""Controls of wind."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from neural_strands.editing.settings import Edit, Wind
from neural_strands.viewer.notices import reporting
from neural_strands.viewer.page import Page
from neural_strands.viewer.wind_player import WindPlayer

if TYPE_CHECKING:
    import viser

DIRECTIONS: dict[str, tuple[float, float, float]] = {
    "from the left": (1.0, 0.0, 0.0),
    "from the right": (-1.0, 0.0, 0.0),
    "from the front": (0.0, 0.0, -1.0),
    "from behind": (0.0, 0.0, 1.0),
    "from below": (0.0, 1.0, 0.0),
}
"""Directions of the wind; left and right are those of a viewer in front of the face."""


def add_wind_panel(page: Page, do: "Callable[[viser.GuiEvent, str, Callable[[], Edit]], None]") -> None:
    """Add the controls of wind.

    Args:
        page: the page whose hair is blown.
        do: carries out an edit, says so, and lists it.
    """
    gui = page.server.gui
    direction = gui.add_dropdown("Direction", tuple(DIRECTIONS))
    strength = gui.add_slider(
        "Strength",
        min=0.0,
        max=5.0,
        step=0.1,
        initial_value=1.0,
        hint="At 1, the wind pushes as much as the hair weighs",
    )
    gusts = gui.add_slider("Gusts", min=0.0, max=1.0, step=0.05, initial_value=0.5, hint="0 is a steady wind")
    simulate = gui.add_checkbox(
        "Simulate", initial_value=False, hint="More realistic: strands swing and slide; large hair plays in slow motion"
    )
    play = gui.add_checkbox("Play the wind", initial_value=False, hint="Adds the wind to the edits and plays it")
    changing = threading.Lock()

    def blow(event: "viser.GuiEvent") -> None:
        # Ignore events that the page itself has caused. If many events arrive at once, each uses the newest settings.
        if event.client is None:
            return
        with changing:
            if not play.value:
                player.stop()
                return
            wanted = Wind(
                direction=DIRECTIONS[direction.value],
                strength=strength.value,
                gusts=gusts.value,
                simulate=simulate.value,
            )
            if wanted not in page.scene.edits:
                do(event, "Adding wind", lambda: wanted)
            blows = False
            with reporting(event.client, "Starting the wind"):
                player.play()
                blows = True
            if not blows:
                play.value = False

    def change(event: "viser.GuiEvent") -> None:
        if play.value:
            blow(event)

    def ended() -> None:
        play.value = False

    player = WindPlayer(page, ended)
    play.on_update(blow)
    for control in (direction, strength, gusts, simulate):
        control.on_update(change)
