"""Controls of what is shown: the rendered picture, and layers in space."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from neural_strands.viewer.layers import STRANDS, Layer, hide, layers_of
from neural_strands.viewer.line_colours import COLOURINGS
from neural_strands.viewer.notices import reporting
from neural_strands.viewer.page import Page

if TYPE_CHECKING:
    import viser


def add_look_panel(page: Page) -> Callable[[], None]:
    """Add the controls for which the scene has content, and draw the initial layers.

    Returns:
        A function that redraws the layers after the scene has changed.
    """
    from viser import Icon

    gui, scene = page.server.gui, page.scene
    start = gui.add_button("Front view", icon=Icon.HOME, hint="Moves the camera in front of the face")
    start.on_click(lambda event: event.client and page.start(event.client))
    if scene.renderer is not None:
        neural = gui.add_checkbox(
            "Rendered hair", initial_value=page.look.neural, hint="The hair as the fitted model renders it"
        )
        neural.on_update(lambda _: page.set_look(replace(page.look, neural=neural.value)))
    layers = {layer.name: layer for layer in layers_of(scene)}

    def show(layer: Layer, visible: bool) -> None:
        if visible:
            layer.draw(page)
        else:
            hide(page.server, layer.name)
        page.mark_visible(layer.name, visible)

    def toggle(layer: Layer, event: "viser.GuiEvent") -> None:
        if not event.target.value:
            show(layer, False)
            return
        with reporting(event.client, f"Drawing: {layer.label.lower()}"):
            show(layer, True)

    def draw_strands() -> None:
        if STRANDS in page.look.objects:
            layers[STRANDS].draw(page)

    for layer in layers.values():
        box = gui.add_checkbox(layer.label, initial_value=layer.at_first, hint=layer.hint)
        box.on_update(partial(toggle, layer))
        # A panel that this one replaces may have shown it.
        show(layer, layer.at_first)
    if STRANDS in layers:
        colouring = gui.add_dropdown(
            "Line colour",
            COLOURINGS,
            initial_value=page.look.colouring,
            hint="Of seen or guessed strands, the guessed ones are orange",
        )

        @colouring.on_update
        def _(_: object) -> None:
            page.set_look(replace(page.look, colouring=colouring.value))
            draw_strands()

    return draw_strands
