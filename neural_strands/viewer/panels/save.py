"""Controls for saving a picture, a turntable, the list of edits, or the hair for other programs."""

import json
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from neural_strands.editing.edit_list import FORMAT, edits_as_json
from neural_strands.foundation.errors import InputError
from neural_strands.geometry.turntable import turntable_cameras
from neural_strands.grooms.scenes.alembic import Blender
from neural_strands.grooms.scenes.scene import SUFFIXES
from neural_strands.pictures.encoding import encode_png
from neural_strands.pictures.video import video_writer
from neural_strands.runs.edited import EditedHair
from neural_strands.runs.export import ExportConfig, export_hair
from neural_strands.viewer.frames import rendered
from neural_strands.viewer.notices import Say, reporting
from neural_strands.viewer.page import FrameRequest, Page, frame_of
from neural_strands.viewer.scene import Scene

if TYPE_CHECKING:
    import viser

SECONDS, FPS = 4.0, 15.0
"""Length of a turntable and its frames per second."""
SIDE = 512
"""Side of a turntable, pixels."""
FORMATS = {
    ".usd": "USD",
    ".usda": "USD as text",
    ".usdc": "USD, binary",
    ".abc": "Alembic",
    ".glb": "glTF lines",
    ".hair": "HAIR",
    ".data": "USC HairSalon",
    ".tfx": "TressFX",
    ".ply": "PLY",
    ".obj": "OBJ",
    ".npz": "NumPy",
}
"""Names of the formats of saved hair."""


def add_save_panel(page: Page) -> None:
    """Add the controls; the browser downloads what they save."""
    gui, scene = page.server.gui, page.scene

    def saving(doing: str, make: "Callable[[viser.ClientHandle, Say], tuple[str, bytes]]") -> Callable:
        def save(event: "viser.GuiEvent") -> None:
            if event.client is not None:
                with reporting(event.client, doing) as say:
                    name, content = make(event.client, say)
                    event.client.send_file_download(name, content, save_immediately=True)

        return save

    if scene.renderer is not None:
        longer = gui.add_slider("Longer side (pixels)", min=256, max=4096, step=256, initial_value=1024)
        picture = gui.add_button("Save this view", hint="The rendered hair as you see it, as a PNG picture")
        picture.on_click(saving("Rendering", lambda client, _: saved_view(page.request_of(client), int(longer.value))))
        turn = gui.add_button("Save a turntable", hint=f"A video of {SECONDS:g} seconds, once around the head")
        turn.on_click(saving("Rendering a turntable", lambda _, say: saved_turntable(page.scene, say)))
    if scene.fitted is not None:
        edits = gui.add_button(
            "Save the edits", hint="The list of edits, which `neural-strands edit --edits` can apply again"
        )
        edits.on_click(saving("Saving the edits", lambda *_: saved_edits(page.scene)))
        gui.add_divider()
        forms = {f"{FORMATS[suffix]} ({suffix})": suffix for suffix in SUFFIXES}
        form = gui.add_dropdown(
            "Format",
            tuple(forms),
            hint="USD for Blender, Houdini and Maya, Alembic for Unreal, glTF for web pages",
        )
        hair = gui.add_button("Save the hair", hint="The strands, with colours and wind if the format stores them")
        hair.on_click(saving("Writing the hair", lambda *_: saved_hair(page.scene, forms[form.value])))


def saved_view(request: FrameRequest, longest: int) -> tuple[str, bytes]:
    """The view of a browser, rendered at a given size: name and content of a PNG."""
    frame = frame_of(request, longest)
    if frame is None:
        raise InputError(
            "Saving the view: expected a rendered picture, found none; tick `Rendered hair` in the tab `View` first."
        )
    return f"{_stem(request.scene)}.png", encode_png(frame.picture)


def saved_turntable(scene: Scene, say: Say) -> tuple[str, bytes]:
    """A video of one turn around the head: name and content."""
    renderer = scene.renderer
    if renderer is None:
        raise InputError("Saving the turntable: expected hair with a model that renders it, found none; open a run.")
    cameras = turntable_cameras(renderer.strands.points, round(SECONDS * FPS), (SIDE, SIDE))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "turntable.mp4"
        with video_writer(path, (SIDE, SIDE), FPS) as write:
            for number, camera in enumerate(cameras, start=1):
                write(rendered(renderer, camera).picture)
                say(f"{number} of {len(cameras)}")
        return f"{_stem(scene)}_turntable.mp4", path.read_bytes()


def saved_edits(scene: Scene) -> tuple[str, bytes]:
    """The applied edits: name and content of a JSON file."""
    document = {"format": FORMAT, "edits": edits_as_json(scene.edits)}
    return f"{_stem(scene)}_edits.json", (json.dumps(document, indent=1) + "\n").encode()


def saved_hair(scene: Scene, suffix: str) -> tuple[str, bytes]:
    """The edited strands for other programs: name and content of a file."""
    if scene.fitted is None or scene.hair is None:
        raise InputError("Saving the hair: expected strands, found none; undo edits, or open other hair.")
    if suffix == ".abc":
        Blender().check()
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"hair{suffix}"
        export_hair(EditedHair(scene.path, scene.fitted, scene.edits, scene.hair), path, ExportConfig(), Blender())
        return f"{_stem(scene)}{suffix}", path.read_bytes()


def _stem(scene: Scene) -> str:
    """A file name without suffix, from the path of the scene."""
    return scene.path.stem or "hair"
