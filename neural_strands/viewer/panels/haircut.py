"""Controls of a haircut: below a plane that the user drags, to a length, or by a fraction."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, get_args

from neural_strands.editing.settings import Dabs, Edit, Haircut
from neural_strands.foundation.errors import InputError
from neural_strands.viewer.page import Page
from neural_strands.viewer.panels.plane_handle import NAME, PlaneHandle, middle_of

if TYPE_CHECKING:
    import viser

Way = Literal["below a plane", "to a length", "by a fraction"]
WAYS: tuple[Way, ...] = get_args(Way)
CENTIMETRE, MILLIMETRE = 0.01, 0.001


class HaircutPanel:
    """The controls, and the plane while it is visible."""

    def __init__(
        self, page: Page, region: Callable[[], Dabs], do: "Callable[[viser.GuiEvent, str, Callable[[], Edit]], None]"
    ) -> None:
        """Add the controls.

        Args:
            page: the page whose hair is cut.
            region: returns the painted region.
            do: applies an edit, shows progress, and lists it.
        """
        gui = page.server.gui
        self._page, self._region = page, region
        self._plane: PlaneHandle | None = None
        self._way = gui.add_dropdown("Cut", WAYS, initial_value=WAYS[0])
        self._length = gui.add_slider("Length (cm)", min=0.5, max=60.0, step=0.5, initial_value=15.0, visible=False)
        self._fraction = gui.add_slider(
            "Fraction cut off", min=0.0, max=1.0, step=0.01, initial_value=0.3, visible=False
        )
        self._uneven = gui.add_slider(
            "Unevenness (mm)", min=0.0, max=30.0, step=0.5, initial_value=3.0, hint="How ragged the cut edge is"
        )
        self._show = gui.add_checkbox(
            "Show the plane", initial_value=False, hint="Drag its arrows and rings to move and turn it"
        )
        cut = gui.add_button("Cut the hair")
        self._way.on_update(lambda _: self._choose())
        self._show.on_update(lambda _: self._set_plane())
        cut.on_click(lambda event: do(event, "Cutting the hair", self._haircut))

    def _choose(self) -> None:
        """Show the controls of the chosen kind of cut."""
        controls = (self._show, self._length, self._fraction)
        for way, control in zip(WAYS, controls, strict=True):
            control.visible = self._way.value == way
        self._show.value = self._show.value and self._way.value == WAYS[0]

    def _set_plane(self) -> None:
        """Show or hide the plane."""
        if self._plane is not None:
            self._plane.remove()
            self._plane = None
        strands = self._page.scene.strands
        if self._show.value and strands is not None and len(strands):
            self._plane = PlaneHandle(self._page.server, middle_of(strands.points))
        self._page.mark_visible(NAME, self._plane is not None)

    def _haircut(self) -> Haircut:
        rough, region = MILLIMETRE * self._uneven.value, self._region()
        if self._way.value == "to a length":
            return Haircut(length=CENTIMETRE * self._length.value, uneven=rough, region=region)
        if self._way.value == "by a fraction":
            return Haircut(fraction=self._fraction.value, uneven=rough, region=region)
        if self._plane is None:
            self._show.value = True
        if self._plane is None:
            # The checkbox was just ticked, and its event has not arrived yet.
            self._set_plane()
        if self._plane is None:
            raise InputError("haircut: expected hair to put a plane through, found none; undo an edit.")
        return Haircut(plane=self._plane.place(), uneven=rough, region=region)
