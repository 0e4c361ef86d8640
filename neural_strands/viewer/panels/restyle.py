"""Controls of restyling: length, curl, wave and volume."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from neural_strands.editing.settings import Dabs, Edit, Restyle
from neural_strands.foundation.errors import InputError
from neural_strands.viewer.page import Page

if TYPE_CHECKING:
    import viser


def add_restyle_panel(
    page: Page, region: Callable[[], Dabs], do: "Callable[[viser.GuiEvent, str, Callable[[], Edit]], None]"
) -> None:
    """Add the controls.

    Args:
        page: whose hair changes.
        region: where it changes.
        do: carries out an edit, says so, and lists it.
    """
    gui = page.server.gui
    length = gui.add_slider(
        "Length factor", min=0.2, max=2.0, step=0.05, initial_value=1.0, hint="0.5 halves every strand, 2 doubles it"
    )
    curl = gui.add_slider("Curl", min=-1.0, max=2.0, step=0.1, initial_value=0.0, hint="Negative values straighten")
    wave = gui.add_slider(
        "Wave", min=0.0, max=2.0, step=0.1, initial_value=0.0, hint="Waves and curls cannot be combined"
    )
    volume = gui.add_slider(
        "Volume", min=-1.0, max=2.0, step=0.1, initial_value=0.0, hint="How far the hair stands off the head"
    )
    go = gui.add_button("Restyle the hair")

    def restyle() -> Restyle:
        wanted = Restyle(length=length.value, curl=curl.value, wave=wave.value, volume=volume.value)
        if wanted == Restyle():
            raise InputError("restyle: expected a change, found every slider where it changes nothing; move one.")
        return replace(wanted, region=region())

    go.on_click(lambda event: do(event, "Restyling the hair", restyle))
