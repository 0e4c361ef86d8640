"""The control that paints a region of the scalp: edits then change only the hair that grows there."""

from typing import TYPE_CHECKING

import numpy as np
import torch

from neural_strands.editing.brush import dab_under
from neural_strands.editing.region import region_weight
from neural_strands.editing.settings import Dab, Dabs
from neural_strands.foundation.errors import InputError
from neural_strands.viewer.layers import hide
from neural_strands.viewer.notices import complain
from neural_strands.viewer.page import Page

if TYPE_CHECKING:
    import viser

NAME = "/painted_region"
COLOUR = (255, 105, 40)
DOT = 0.0012
"""Size of the dots that show painted roots, metres."""
CENTIMETRE = 0.01


class RegionBrush:
    """A brush that a person clicks with, and the dabs that it has left."""

    def __init__(self, page: Page) -> None:
        """Add the controls.

        Args:
            page: its hair has `root_uv`.
        """
        gui = page.server.gui
        self._page = page
        self._dabs: list[Dab] = []
        self._paint = gui.add_checkbox(
            "Paint", initial_value=False, hint="Click on the scalp to add to the region; dragging still turns the head"
        )
        self._radius = gui.add_slider("Brush, cm", min=0.5, max=8.0, step=0.5, initial_value=3.0, visible=False)
        self._clear = gui.add_button("Clear the region", color="gray", visible=False)
        self._says = gui.add_markdown("")
        self._paint.on_update(lambda _: self._set_painting())
        self._clear.on_click(lambda _: self.clear())
        self._draw()

    def dabs(self) -> Dabs:
        """The painted region, as edits take it; empty for the whole scalp."""
        return tuple(self._dabs)

    def clear(self) -> None:
        """Forget the region: edits change all of the hair again."""
        self._dabs.clear()
        self._draw()

    def _set_painting(self) -> None:
        scene = self._page.server.scene
        scene.remove_click_callback(self._click)
        if self._paint.value:
            scene.on_click()(self._click)
        # Where the brush is seen, a click paints.
        self._radius.visible = self._paint.value

    def _click(self, event: "viser.SceneClickEvent") -> None:
        fitted = self._page.scene.fitted
        if fitted is None or fitted.strands.root_uv is None:
            return
        roots, uv = fitted.strands.points[:, 0], fitted.strands.root_uv
        origin, direction = (torch.tensor(each).to(roots) for each in (event.ray_origin, event.ray_direction))
        try:
            self._dabs.append(dab_under(origin, direction, roots, uv, CENTIMETRE * self._radius.value))
        except InputError as error:
            complain(event.client, error)
        self._draw()

    def _draw(self) -> None:
        """Show which roots are painted."""
        self._clear.visible = bool(self._dabs)
        fitted, scene = self._page.scene.fitted, self._page.server.scene
        if not self._dabs or fitted is None or fitted.strands.root_uv is None:
            hide(self._page.server, NAME)
            self._says.content = "Haircut and restyling change all of the hair."
            return
        weight = region_weight(fitted.strands.root_uv, self.dabs()).cpu()
        painted = fitted.strands.points[:, 0].cpu()[weight > 0].numpy()
        self._says.content = (
            f"Haircut and restyling change the {len(painted):,} strands that grow in the painted region."
        )
        scene.add_point_cloud(
            NAME, painted, np.array(COLOUR, np.uint8), point_size=DOT, point_shape="circle", precision="float32"
        )
