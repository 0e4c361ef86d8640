"""The controls that change hair: haircut, number of strands, and undo."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, get_args

from neural_strands.editing.edit_list import edits_as_json
from neural_strands.editing.settings import MOST_STRANDS, Density, Edit, Haircut
from neural_strands.viewer.history import History
from neural_strands.viewer.notices import told
from neural_strands.viewer.page import Page
from neural_strands.viewer.panels.plane_handle import PlaneHandle, middle_of
from neural_strands.viewer.panels.wind import add_wind_panel

if TYPE_CHECKING:
    import viser

Way = Literal["below the plane", "to a length", "by a share"]
WAYS: tuple[Way, ...] = get_args(Way)
CHANGES: dict[str, Callable[[History], History]] = {
    "Undo": History.back,
    "Redo": History.forward,
    "Start over": History.cleared,
}
"""What the buttons do to the list of edits."""
CENTIMETRE, MILLIMETRE = 0.01, 0.001


class EditPanel:
    """The controls, and what has been done with them."""

    def __init__(self, page: Page, redraw: Callable[[], None]) -> None:
        """Add the controls of what can be done to the page's hair.

        Args:
            page: whose hair is changed.
            redraw: draws anew whatever else shows the hair.
        """
        gui = page.server.gui
        self._page, self._redraw = page, redraw
        changes = gui.add_button_group("Edits", tuple(CHANGES))
        self._list = gui.add_markdown("")
        changes.on_click(lambda event: self._change(event, CHANGES[changes.value]))
        with gui.add_folder("Haircut"):
            self._add_haircut()
        if page.scene.fitted is not None and page.scene.fitted.model is not None:
            with gui.add_folder("Number of strands", expand_by_default=False):
                self._add_density(len(page.scene.fitted.strands))
            with gui.add_folder("Wind", expand_by_default=False):
                add_wind_panel(page, self._do)
        self.describe()

    def _add_haircut(self) -> None:
        gui = self._page.server.gui
        way = gui.add_dropdown("Cut", WAYS, initial_value=WAYS[0])
        length = gui.add_slider("Length, cm", min=0.5, max=60.0, step=0.5, initial_value=15.0, visible=False)
        share = gui.add_slider("Share cut off", min=0.0, max=1.0, step=0.01, initial_value=0.3, visible=False)
        uneven = gui.add_slider(
            "Unevenness, mm", min=0.0, max=30.0, step=0.5, initial_value=3.0, hint="How ragged the edge is"
        )
        show = gui.add_checkbox("Show the plane", initial_value=False, hint="Drag its arrows and rings to place it")
        cut = gui.add_button("Cut the hair")
        planes: list[PlaneHandle] = []

        def set_plane() -> None:
            while planes:
                planes.pop().remove()
            strands = self._page.scene.strands
            if show.value and strands is not None and len(strands):
                planes.append(PlaneHandle(self._page.server, middle_of(strands.points)))

        @way.on_update
        def _(_: object) -> None:
            length.visible, share.visible, show.visible = (way.value == name for name in (WAYS[1], WAYS[2], WAYS[0]))
            show.value = show.value and way.value == WAYS[0]
            set_plane()

        show.on_update(lambda _: set_plane())

        def haircut() -> Haircut:
            rough = MILLIMETRE * uneven.value
            if way.value == "to a length":
                return Haircut(length=CENTIMETRE * length.value, uneven=rough)
            if way.value == "by a share":
                return Haircut(fraction=share.value, uneven=rough)
            strands = self._page.scene.strands
            if not planes and strands is not None:
                show.value = True
                set_plane()
            return Haircut(plane=planes[0].place(), uneven=rough)

        cut.on_click(lambda event: self._do(event, "Cutting the hair", haircut))

    def _add_density(self, fitted: int) -> None:
        gui = self._page.server.gui
        count = gui.add_number("Strands", initial_value=fitted, min=1, max=MOST_STRANDS, step=1)
        grow = gui.add_button("Grow this many")
        grow.on_click(lambda event: self._do(event, "Growing strands", lambda: Density(int(count.value))))

    def _do(self, event: "viser.GuiEvent", doing: str, edit: Callable[[], Edit]) -> None:
        with told(event.client, doing):
            wanted = edit()
            self._page.edit(lambda history: history.with_edit(wanted))
            self._redraw()
            self.describe()

    def _change(self, event: "viser.GuiEvent", change: Callable[[History], History]) -> None:
        with told(event.client, "Changing the hair"):
            self._page.edit(change)
            self._redraw()
            self.describe()

    def describe(self) -> None:
        """List what has been done."""
        strands = self._page.scene.strands
        lines = [f"{number}. {described(edit)}" for number, edit in enumerate(self._page.history.done, start=1)]
        count = 0 if strands is None else len(strands)
        self._list.content = "\n".join([*lines, "", f"{count:,} strands"])


def described(edit: Edit) -> str:
    """An edit in a few words, with its settings."""
    (document,) = edits_as_json([edit])
    name = document.pop("edit")
    document.pop("seed", None)
    settings = ", ".join(f"{key} {_short(value)}" for key, value in document.items())
    return f"{name}: {settings}"


def _short(value: object) -> str:
    if isinstance(value, float):
        return f"{round(value, 3) + 0.0:g}"
    return " ".join(_short(each) for each in value) if isinstance(value, tuple | list) else str(value)
