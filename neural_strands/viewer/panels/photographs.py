"""Controls that place a browser's camera where a photograph was taken, and compare rendering and photograph."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.views import Views
from neural_strands.viewer.notices import reporting
from neural_strands.viewer.page import Page

if TYPE_CHECKING:
    import viser


def add_photographs_panel(page: Page, views: Views) -> None:
    """Add the choice of a photograph and the slider."""
    from viser import Icon

    gui = page.server.gui
    names = tuple(f"{number}: {camera.name}" for number, camera in enumerate(views.cameras, start=1))
    choice = gui.add_dropdown("Photograph", names, initial_value=names[frontal(views.cameras)])
    go = gui.add_button("Look from there", icon=Icon.CAMERA, hint="Moves the camera to where the photograph was taken")
    wipe = gui.add_slider(
        "Photograph | rendering",
        min=0.0,
        max=1.0,
        step=0.01,
        initial_value=page.look.wipe,
        hint="How much of the picture shows the photograph, while the camera is where it was taken",
    )
    wipe.on_update(lambda _: page.set_look(replace(page.look, wipe=wipe.value)))

    def jump(event: "viser.GuiEvent") -> None:
        if event.client is not None:
            with reporting(event.client, "Reading the photograph"):
                page.jump(event.client, names.index(choice.value))

    go.on_click(jump)
    choice.on_update(jump)


def frontal(cameras: Sequence[Camera]) -> int:
    """Index of the camera that looks most directly at the face, which looks along +z."""
    return min(range(len(cameras)), key=lambda index: float(cameras[index].rotation[2, 2]))
