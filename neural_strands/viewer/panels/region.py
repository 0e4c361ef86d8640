"""The control that paints a region of the scalp: edits then change only the hair that grows there."""

import contextlib
import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.editing.brush import dab_under
from neural_strands.editing.region import region_weight
from neural_strands.editing.settings import Dab, Dabs
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.point_queries import nearest
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
SCALP = "/painted_scalp"
"""What a brush can be dragged over; nobody sees it."""
NEAR_ROOTS = 0.02
"""Distance from a root up to which the head can be painted on, metres."""
STRIDE = 0.3
"""Distance between the dabs of a brush that is dragged, in its radii."""


class RegionBrush:
    """A brush that a person clicks with or drags, and the dabs that it has left."""

    def __init__(self, page: Page) -> None:
        """Add the controls.

        Args:
            page: its hair has `root_uv`.
        """
        gui = page.server.gui
        self._page = page
        self._dabs: list[Dab] = []
        self._paint = gui.add_checkbox(
            "Paint", initial_value=False, hint="Click on the scalp, or drag over it; drag beside it to turn the head"
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
        hide(self._page.server, SCALP)
        if self._paint.value:
            scene.on_click()(self._click)
            self._add_scalp()
        # Where the brush is seen, a click paints.
        self._radius.visible = self._paint.value

    def _add_scalp(self) -> None:
        """Let a brush be dragged over the head where hair grows; a groom without a head takes clicks alone."""
        page = self._page
        head, fitted = page.scene.head, page.scene.fitted
        if head is None or fitted is None:
            return
        gap, _ = nearest(head.vertices, fitted.strands.points[:, 0].to(head.vertices), NEAR_ROOTS)
        faces = head.faces[gap.isfinite()[head.faces].all(dim=1)]
        if len(faces):
            mesh = page.server.scene.add_mesh_simple(
                SCALP, head.vertices.numpy(), faces.numpy().astype(np.uint32), opacity=0.0, cast_shadow=False
            )
            mesh.on_drag("left")(self._drag)

    def _click(self, event: "viser.SceneClickEvent") -> None:
        try:
            self._dab(torch.tensor(event.ray_origin), torch.tensor(event.ray_direction))
        except InputError as error:
            complain(event.client, error)

    def _drag(self, event: "viser.SceneNodeDragEvent[viser.MeshHandle]") -> None:
        origin = torch.tensor(event.client.camera.position)
        # A brush that is dragged off the scalp comes back.
        with contextlib.suppress(InputError):
            self._dab(origin, torch.tensor(event.end_position) - origin, STRIDE)

    def _dab(self, origin: Float[Tensor, "3"], direction: Float[Tensor, "3"], stride: float = 0.0) -> None:
        """Paint under a ray, unless the last dab is nearer than `stride` radii.

        Raises:
            InputError: no root lies near the ray.
        """
        fitted = self._page.scene.fitted
        if fitted is None or fitted.strands.root_uv is None:
            return
        roots, uv = fitted.strands.points[:, 0], fitted.strands.root_uv
        dab = dab_under(origin.to(roots), direction.to(roots), roots, uv, CENTIMETRE * self._radius.value)
        if self._dabs and math.dist(dab[:2], self._dabs[-1][:2]) < stride * dab[2]:
            return
        self._dabs.append(dab)
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
