"""Controls that change hair, and the list of edits with undo."""

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

from neural_strands.editing.edit_list import edits_as_json
from neural_strands.editing.hair import Hair
from neural_strands.editing.settings import MOST_STRANDS, Dabs, Density, Edit
from neural_strands.viewer.history import History
from neural_strands.viewer.notices import reporting
from neural_strands.viewer.page import Page
from neural_strands.viewer.panels.haircut import HaircutPanel
from neural_strands.viewer.panels.mix import add_mix_panel, add_sample_panel
from neural_strands.viewer.panels.region import RegionBrush
from neural_strands.viewer.panels.restyle import add_restyle_panel
from neural_strands.viewer.panels.wind import add_wind_panel

if TYPE_CHECKING:
    import viser

CHANGES: dict[str, Callable[[History], History]] = {
    "Undo": History.back,
    "Redo": History.forward,
    "Start over": History.cleared,
}
"""Effects of the buttons on the list of edits."""
SWITCHES = {"simulate": "simulated"}
"""How settings that are on are listed."""
MOST_NUMBERS = 3
"""Settings with more numbers, such as a plane, are listed without them."""


class EditPanel:
    """The controls and the list of edits."""

    def __init__(self, page: Page, fitted: Hair, redraw: Callable[[], None]) -> None:
        """Add the controls for the edits that the page's hair allows.

        Args:
            page: the page whose hair is changed.
            fitted: the hair before any edit, which determines the available edits.
            redraw: redraws everything else that shows the hair.
        """
        gui = page.server.gui
        self._page, self._redraw = page, redraw
        changes = gui.add_button_group("Edits", tuple(CHANGES))
        self._list = gui.add_markdown("")
        changes.on_click(lambda event: self._change(event, CHANGES[changes.value]))
        region: Callable[[], Dabs] = tuple
        if fitted.strands.root_uv is not None:
            with gui.add_folder("Region", expand_by_default=False):
                region = RegionBrush(page).dabs
        with gui.add_folder("Haircut"):
            HaircutPanel(page, region, self._do)
        if fitted.model is not None:
            with gui.add_folder("Restyle", expand_by_default=False):
                add_restyle_panel(page, region, self._do)
            with gui.add_folder("Number of strands", expand_by_default=False):
                self._add_density(len(fitted.strands))
            with gui.add_folder("Another run", expand_by_default=False):
                add_mix_panel(page, region, self._do)
            with gui.add_folder("New hairstyle", expand_by_default=False):
                add_sample_panel(page, self._do)
            with gui.add_folder("Wind", expand_by_default=False):
                add_wind_panel(page, self._do)
        self.describe()

    def _add_density(self, fitted: int) -> None:
        gui = self._page.server.gui
        count = gui.add_number("Strands", initial_value=fitted, min=1, max=MOST_STRANDS, step=1)
        change = gui.add_button("Change the number")
        change.on_click(
            lambda event: self._do(event, "Changing the number of strands", lambda: Density(int(count.value)))
        )

    def _do(self, event: "viser.GuiEvent", doing: str, edit: Callable[[], Edit]) -> None:
        with reporting(event.client, doing):
            wanted = edit()
            self._page.edit(lambda history: history.with_edit(wanted))
            self._redraw()
            self.describe()

    def _change(self, event: "viser.GuiEvent", change: Callable[[History], History]) -> None:
        with reporting(event.client, "Changing the hair"):
            self._page.edit(change)
            self._redraw()
            self.describe()

    def describe(self) -> None:
        """Update the list of edits."""
        strands = self._page.scene.strands
        lines = [f"{number}. {described(edit)}" for number, edit in enumerate(self._page.history.done, start=1)]
        count = 0 if strands is None else len(strands)
        self._list.content = "\n".join([*lines, "", f"{count:,} strands"])


def described(edit: Edit) -> str:
    """Summarise an edit: its name and the settings that differ from the defaults."""
    usual = {field.name: field.default for field in dataclasses.fields(edit)}
    (document,) = edits_as_json([edit])
    name = document.pop("edit")
    painted = "region" in document
    for hidden in ("seed", "region"):
        document.pop(hidden, None)
    settings = [_setting(key, value) for key, value in document.items() if value != usual[key]]
    return name + (": " if settings else "") + ", ".join(settings) + (" in the painted region" if painted else "")


def _setting(name: str, value: object) -> str:
    return SWITCHES[name] if value is True else f"{name} {_short(value)}".strip()


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{round(value, 3) + 0.0:g}"
    if isinstance(value, tuple | list):
        return " ".join(_short(each) for each in value) if len(value) <= MOST_NUMBERS else ""
    return str(value)
