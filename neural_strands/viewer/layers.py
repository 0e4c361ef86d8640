"""What a page draws in space, apart from the rendered picture: strands, segments, head and cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.pictures.encoding import to_bytes
from neural_strands.viewer.clay import clay_glb
from neural_strands.viewer.line_colours import segment_lines, strand_lines
from neural_strands.viewer.notices import reporting
from neural_strands.viewer.page import Page
from neural_strands.viewer.scene import Scene

if TYPE_CHECKING:
    import viser

STRANDS, SEGMENTS, HEAD, CAMERAS = "/strands", "/segments", "/head", "/cameras"
STRANDS_HINT = "The strands themselves; of very many, only some are drawn"
SEGMENTS_HINT = "Short pieces of hair that were measured in the photographs"
HEAD_HINT = "The surface of head and body"
CAMERAS_HINT = "Where the photographs were taken; click on one to look from there"
LINE_PIXELS = 1.5
SKIN = (204, 194, 186)
THUMBNAIL = 128
"""Longer side of a photograph in space, pixels."""
FRUSTUM = 0.04
"""Size of a camera in space, metres."""


@dataclass(frozen=True)
class Layer:
    """One kind of thing in space.

    Attributes:
        name: name of its scene node, or of the parent of its nodes.
        label: text in the panel.
        hint: what the label does not say.
        draw: adds or replaces it.
        at_first: whether it is shown when a page opens.
    """

    name: str
    label: str
    hint: str
    draw: "Callable[[Page], None]"
    at_first: bool


def layers_of(scene: Scene) -> list[Layer]:
    """The layers for which a scene has content; with a rendered picture, none of them is shown at first."""
    found = []
    if scene.strands is not None and len(scene.strands):
        found.append(Layer(STRANDS, "Strands as lines", STRANDS_HINT, _draw_strands, scene.renderer is None))
    if scene.segments is not None and len(scene.segments):
        found.append(Layer(SEGMENTS, "Line segments", SEGMENTS_HINT, _draw_segments, False))
    if scene.head is not None and len(scene.head.faces):
        found.append(Layer(HEAD, "Head", HEAD_HINT, _draw_head, scene.renderer is None))
    if scene.photographs is not None:
        found.append(Layer(CAMERAS, "Cameras", CAMERAS_HINT, _draw_cameras, scene.kind == "capture"))
    return found


def _draw_strands(page: Page) -> None:
    server, scene = page.server, page.scene
    assert scene.strands is not None
    points, colours = strand_lines(scene.strands, page.look.colouring)
    server.scene.add_line_segments(STRANDS, points, colours, thickness=LINE_PIXELS, thickness_units="screen")


def _draw_segments(page: Page) -> None:
    server, scene = page.server, page.scene
    assert scene.segments is not None
    points, colours = segment_lines(scene.segments)
    server.scene.add_line_segments(SEGMENTS, points, colours, thickness=LINE_PIXELS, thickness_units="screen")


def _draw_head(page: Page) -> None:
    server, scene = page.server, page.scene
    assert scene.head is not None
    server.scene.add_glb(HEAD, clay_glb(scene.head, SKIN))


def _draw_cameras(page: Page) -> None:
    server, scene = page.server, page.scene
    assert scene.photographs is not None
    small = scene.photographs.reduced(THUMBNAIL)
    server.scene.add_frame(CAMERAS, show_axes=False)
    for index, camera in enumerate(small.cameras):
        frustum = server.scene.add_camera_frustum(
            f"{CAMERAS}/{index}",
            fov=2 * float(torch.atan(0.5 * camera.height / camera.intrinsics[1, 1])),
            aspect=camera.width / camera.height,
            scale=FRUSTUM,
            thickness=LINE_PIXELS,
            thickness_units="screen",
            image=to_bytes(small.image(index)),
            wxyz=wxyz_of(camera),
            position=tuple(camera.position.tolist()),
        )
        frustum.on_click(partial(_jump, page, index))


def _jump(page: Page, photograph: int, event: "viser.SceneNodePointerEvent") -> None:
    with reporting(event.client, "Reading the photograph"):
        page.jump(event.client, photograph)


def hide(server: "viser.ViserServer", name: str) -> None:
    """Remove the scene node with a name, if there is one."""
    if server.scene.get_handle_by_name(name) is not None:
        server.scene.remove_by_name(name)


def wxyz_of(camera: Camera) -> tuple[float, float, float, float]:
    """Rotation from camera to world as a quaternion."""
    from viser.transforms import SO3

    w, x, y, z = SO3.from_matrix(camera.rotation.T.double().cpu().numpy()).wxyz.tolist()
    return w, x, y, z
