"""Controls that paint a region of the scalp, to which edits are then limited."""

import contextlib
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.brush import dab_under
from neural_strands.editing.region import region_weight
from neural_strands.editing.settings import Dab, Dabs
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh
from neural_strands.viewer.clay import clay_glb
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
BRUSH = "/region_brush"
BALL = 0.007
"""Radius of the ball that the user drags over the scalp, metres."""
STRIDE = 0.3
"""Distance between the dabs of a dragged brush, in multiples of its radius."""


class RegionBrush:
    """A brush for clicking, or dragging as a ball over the scalp, and the dabs that it has painted."""

    def __init__(self, page: Page) -> None:
        """Add the controls.

        Args:
            page: the page, whose hair has `root_uv`.
        """
        gui = page.server.gui
        self._page = page
        self._dabs: list[Dab] = []
        self._paint = gui.add_checkbox(
            "Paint",
            initial_value=False,
            hint="Click on the scalp, or drag the ball over it; dragging elsewhere turns the view",
        )
        self._radius = gui.add_slider("Brush radius (cm)", min=0.5, max=8.0, step=0.5, initial_value=3.0, visible=False)
        self._clear = gui.add_button("Clear the region", color="gray", visible=False)
        self._says = gui.add_markdown("")
        self._paint.on_update(lambda _: self._set_painting())
        self._clear.on_click(lambda _: self.clear())
        self._draw()

    def dabs(self) -> Dabs:
        """The painted region, in the format of edits; empty for the whole scalp."""
        return tuple(self._dabs)

    def clear(self) -> None:
        """Clear the region, so that edits change all of the hair again."""
        self._dabs.clear()
        self._draw()

    def _set_painting(self) -> None:
        scene = self._page.server.scene
        scene.remove_click_callback(self._click)
        hide(self._page.server, BRUSH)
        if self._paint.value:
            scene.on_click()(self._click)
            self._add_ball()
        # While the brush is visible, clicks paint.
        self._radius.visible = self._paint.value
        self._set_seen_through()

    def _set_seen_through(self) -> None:
        """Let the hair hide nothing while there are marks on the scalp."""
        painting = self._paint.value or bool(self._dabs)
        if painting != self._page.look.painting:
            self._page.set_look(replace(self._page.look, painting=painting))

    def _add_ball(self) -> None:
        """Show a ball on the scalp, above the forehead, that paints when it is dragged."""
        roots, _ = self._roots()
        if len(roots):
            first = roots[roots[:, 1:].sum(dim=1).argmax()]
            # Loaded here because it takes longer than the rest of the page's code.
            import trimesh

            sphere = trimesh.creation.icosphere(subdivisions=3, radius=BALL)
            ball = Mesh(torch.from_numpy(sphere.vertices).float(), torch.from_numpy(sphere.faces).long())
            handle = self._page.server.scene.add_glb(BRUSH, clay_glb(ball, COLOUR), position=first.cpu().numpy())
            handle.on_drag("left")(self._drag)

    def _click(self, event: "viser.SceneClickEvent") -> None:
        try:
            self._paint_under(torch.tensor(event.ray_origin), torch.tensor(event.ray_direction))
        except InputError as error:
            complain(event.client, error)

    def _drag(self, event: "viser.SceneNodeDragEvent[viser.GlbHandle]") -> None:
        eye = torch.tensor(event.client.camera.position)
        # Off the scalp, the ball stays where it was.
        with contextlib.suppress(InputError):
            place = self._paint_under(eye, torch.tensor(event.end_position) - eye, STRIDE)
            event.target.position = place.cpu().numpy()

    def _paint_under(
        self, origin: Float[Tensor, "3"], direction: Float[Tensor, "3"], stride: float = 0.0
    ) -> Float[Tensor, "3"]:
        """Paint where a ray meets the scalp, unless the last dab is nearer than `stride` radii; returns that point.

        Raises:
            InputError: no root lies near the ray.
        """
        roots, uv = self._roots()
        dab = dab_under(origin.to(roots), direction.to(roots), roots, uv, CENTIMETRE * self._radius.value)
        if not self._dabs or math.dist(dab[:2], self._dabs[-1][:2]) >= stride * dab[2]:
            self._dabs.append(dab)
            self._draw()
        return roots[(uv - uv.new_tensor(dab[:2])).square().sum(dim=1).argmin()]

    def _roots(self) -> tuple[Float[Tensor, "root 3"], Float[Tensor, "root 2"]]:
        """Roots of the fitted hair, and their chart coordinates; empty if the chart is unknown."""
        fitted = self._page.scene.fitted
        if fitted is None or fitted.strands.root_uv is None:
            return torch.zeros(0, 3), torch.zeros(0, 2)
        return fitted.strands.points[:, 0], fitted.strands.root_uv

    def _draw(self) -> None:
        """Show the painted roots as dots."""
        self._clear.visible = bool(self._dabs)
        self._set_seen_through()
        roots, uv = self._roots()
        if not self._dabs or not len(roots):
            hide(self._page.server, NAME)
            self._says.content = "Nothing is painted: edits change all of the hair."
            return
        painted = roots[region_weight(uv, self.dabs()) > 0].cpu().numpy()
        self._says.content = (
            f"Haircut, restyling and mixing change only the {len(painted):,} strands that grow in the painted region."
        )
        self._page.server.scene.add_point_cloud(
            NAME, painted, np.array(COLOUR, np.uint8), point_size=DOT, point_shape="circle", precision="float32"
        )
