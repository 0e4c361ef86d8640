"""Controls for other hairstyles: those of another run, or new ones from the strand prior."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from neural_strands.editing.settings import Blend, Dabs, Edit, Sample, Transfer
from neural_strands.foundation.errors import InputError
from neural_strands.viewer.page import Page

if TYPE_CHECKING:
    import viser


def add_mix_panel(
    page: Page, region: Callable[[], Dabs], do: "Callable[[viser.GuiEvent, str, Callable[[], Edit]], None]"
) -> None:
    """Add the controls for another run's hair.

    Args:
        page: whose hair changes.
        region: returns the painted region.
        do: carries out an edit, says so, and lists it.
    """
    gui = page.server.gui
    other = gui.add_text("Other run", initial_value="", hint="Its folder, on the computer that runs the viewer")
    share = gui.add_slider(
        "Share of the other",
        min=0.0,
        max=1.0,
        step=0.05,
        initial_value=0.5,
        hint="0 keeps this hair, 1 takes the other's",
    )
    mix = gui.add_button("Mix the hairstyles")
    take = gui.add_button("Use the other hairstyle", hint="The other run's strands with this run's colours")

    def named() -> str:
        path = other.value.strip()
        if not path:
            raise InputError("Other run: expected its folder, found an empty field; type the folder's path.")
        return path

    mix.on_click(lambda event: do(event, "Mixing the hair", lambda: Blend(named(), share.value, region())))
    take.on_click(lambda event: do(event, "Changing the hairstyle", lambda: Transfer(named())))


def add_sample_panel(page: Page, do: "Callable[[viser.GuiEvent, str, Callable[[], Edit]], None]") -> None:
    """Add the controls for new hairstyles.

    Args:
        page: whose hair changes.
        do: carries out an edit, says so, and lists it.
    """
    gui = page.server.gui
    likeness = gui.add_slider(
        "Likeness",
        min=0.0,
        max=1.0,
        step=0.05,
        initial_value=Sample.likeness,
        hint="How much of this hairstyle remains: 0 nothing, 1 all of it",
    )
    variety = gui.add_slider(
        "Variety",
        min=0.0,
        max=1.0,
        step=0.05,
        initial_value=Sample.variety,
        hint="How much the strands differ from each other",
    )
    seed = gui.add_number(
        "Style number", initial_value=0, min=0, max=2**31 - 1, step=1, hint="Every number gives another hairstyle"
    )
    make = gui.add_button("Make this hairstyle")
    make.on_click(
        lambda event: do(event, "Making a hairstyle", lambda: Sample(likeness.value, variety.value, int(seed.value)))
    )
