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
    other = gui.add_text("Other run", initial_value="", hint="Its folder, on the machine that serves this page")
    share = gui.add_slider(
        "Share of the other", min=0.0, max=1.0, step=0.05, initial_value=0.5, hint="0 is this run's hair, 1 the other's"
    )
    mix = gui.add_button("Mix the two")
    take = gui.add_button("Take the other's hair", hint="The other run's strands, with the colours of this one")

    def named() -> str:
        path = other.value.strip()
        if not path:
            raise InputError("Mixing: expected the folder of another run, found none; type it into the field.")
        return path

    mix.on_click(lambda event: do(event, "Mixing the hair", lambda: Blend(named(), share.value, region())))
    take.on_click(lambda event: do(event, "Taking the other hair", lambda: Transfer(named())))


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
        hint="1 keeps this run's hair, 0 takes nothing from it",
    )
    variety = gui.add_slider(
        "Variety",
        min=0.0,
        max=1.0,
        step=0.05,
        initial_value=Sample.variety,
        hint="How much neighbouring strands differ",
    )
    seed = gui.add_number("Style number", initial_value=0, min=0, max=2**31 - 1, step=1)
    grow = gui.add_button("Grow this style")
    grow.on_click(
        lambda event: do(event, "Growing a hairstyle", lambda: Sample(likeness.value, variety.value, int(seed.value)))
    )
