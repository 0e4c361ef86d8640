"""A page: one scene shared by all browsers, each with its own camera and picture."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.model.renderer import HairRenderer
from neural_strands.pictures.encoding import to_bytes
from neural_strands.viewer.cameras import PageCamera, Pose, photograph_pose, start_pose
from neural_strands.viewer.frames import Frame, rendered, seen_by, wiped
from neural_strands.viewer.history import History
from neural_strands.viewer.line_colours import Colouring
from neural_strands.viewer.render_loop import FINER, RenderLoop
from neural_strands.viewer.scene import Scene

if TYPE_CHECKING:
    import viser

JPEG_QUALITY = 85
PAPER = 255
"""Grey level behind a photograph if there is no rendering."""


@dataclass(frozen=True)
class Look:
    """Settings of the view that all browsers share.

    Attributes:
        neural: whether the rendered picture lies behind everything else.
        wipe: share of the width on which a photograph covers the rendering, for a browser at its camera.
        colouring: meaning of the colours of lines.
        objects: names of the objects in space that are visible; rendered hair and body hide what lies behind them.
        painting: whether marks on the scalp are visible; they are seen through the hair, and so are all objects then.
    """

    neural: bool = True
    wipe: float = 0.5
    colouring: Colouring = "hair colour"
    objects: frozenset[str] = frozenset()
    painting: bool = False

    @property
    def hides(self) -> bool:
        """Whether the picture hides objects behind its hair and body."""
        return bool(self.objects) and not self.painting


@dataclass(frozen=True)
class Standing:
    """A browser whose camera is where the page has placed it, until the user moves it.

    Attributes:
        pose: pose of the camera.
        aspect: aspect ratio of the canvas for which the pose was chosen.
        photograph: index of the photograph taken from there; None for the pose in front of the face.
        arrived: whether the browser has confirmed the pose; until then it may still report its previous one.
    """

    pose: Pose
    aspect: float
    photograph: int | None = None
    arrived: bool = False


@dataclass(frozen=True)
class FrameRequest:
    """Everything that a picture shows; equal requests give the same picture.

    Attributes:
        camera: camera of the browser.
        scene: the scene to render.
        look: shared settings.
        photograph: index of the photograph to compare with, or None.
        moment: renderer of moving hair, in place of the scene's hair at rest.
    """

    camera: PageCamera
    scene: Scene
    look: Look
    photograph: int | None = None
    moment: HairRenderer | None = None


class Page:
    """The state behind a page.

    Attributes:
        server: viser's.
        scene: as shown now, edits included.
        look: as set in the panel.
        history: edits of the hair, done and undone.
    """

    def __init__(self, server: "viser.ViserServer", scene: Scene, finer: tuple[int, ...] = FINER) -> None:
        """Show a scene to every browser that connects.

        Args:
            server: viser's.
            scene: the initial scene.
            finer: sizes of the pictures once the camera rests (`RenderLoop`).
        """
        self.server = server
        self.scene = scene
        self.look = Look()
        self.history = History(scene.edits)
        self._moment: HairRenderer | None = None
        self._editing = threading.Lock()
        self._standing: dict[int, Standing] = {}
        self._lock = threading.Lock()
        self._asking = threading.Lock()
        self._loop = RenderLoop(self._draw, finer)
        server.scene.set_up_direction("+y")
        server.on_client_connect(self._welcome)
        server.on_client_disconnect(self._part)

    def close(self) -> None:
        """End the drawing thread."""
        self._loop.stop()

    def show(self, scene: Scene) -> None:
        """Show another scene without moving cameras; the present edits are applied to it as well.

        Raises:
            InputError: the edits do not suit that hair.
        """
        with self._editing:
            self.scene = scene.with_edits(self.history.done)
        self.redraw()

    def edit(self, change: Callable[[History], History]) -> None:
        """Change the history of edits, one change at a time; if it fails, everything stays unchanged.

        Raises:
            InputError: an edit does not suit the hair, or none of it would remain.
        """
        with self._editing:
            history = change(self.history)
            self.scene = self.scene.with_edits(history.done)
            self.history = history
        self.redraw()

    def show_moment(self, moment: HairRenderer | None) -> None:
        """Show moving hair; None shows it at rest."""
        self._moment = moment
        self.redraw()

    def set_look(self, look: Look) -> None:
        """Change what all browsers see."""
        self.look = look
        self.redraw()

    def mark_visible(self, name: str, visible: bool) -> None:
        """Note that an object in space has been added or removed, because pictures need a depth to hide it."""
        objects = self.look.objects | {name} if visible else self.look.objects - {name}
        if objects != self.look.objects:
            self.set_look(replace(self.look, objects=objects))

    def redraw(self) -> None:
        """Request a new picture for every browser."""
        for client in self.server.get_clients().values():
            self._ask(client)

    def start(self, client: "viser.ClientHandle") -> None:
        """Place a browser's camera in front of the face."""
        self._stand(client, None)

    def jump(self, client: "viser.ClientHandle", photograph: int) -> None:
        """Place a browser's camera where a photograph was taken.

        Raises:
            InputError: there are no photographs.
        """
        if self.scene.photographs is None:
            raise InputError(f"{self.scene.path}: expected photographs, found none; open a run that has some.")
        self._stand(client, photograph)

    def request_of(self, client: "viser.ClientHandle") -> FrameRequest:
        """The picture that a browser should show now."""
        with self._lock:
            standing = self._standing.get(client.client_id)
        photograph = standing.photograph if standing is not None and standing.arrived else None
        return FrameRequest(self.camera_of(client), self.scene, self.look, photograph, self._moment)

    def camera_of(self, client: "viser.ClientHandle") -> PageCamera:
        """The present camera of a browser."""
        w, x, y, z = (float(value) for value in client.camera.wxyz)
        right, up, back = (float(value) for value in client.camera.position)
        aspect = min(max(client.camera.aspect, 0.05), 20.0)
        return PageCamera((w, x, y, z), (right, up, back), client.camera.fov, aspect)

    def _stand(self, client: "viser.ClientHandle", photograph: int | None) -> None:
        points, aspect, views = self._points(), self.camera_of(client).aspect, self.scene.photographs
        if photograph is None or views is None:
            pose = start_pose(points, aspect)
        else:
            centre = points.mean(dim=0) if len(points) else torch.zeros(3)
            pose = photograph_pose(views.cameras[photograph].to("cpu"), aspect, centre)
        with self._lock:
            self._standing[client.client_id] = Standing(pose, aspect, photograph)
        place(client, pose)
        self._ask(client)

    def _points(self) -> torch.Tensor:
        """Points that the first view should contain: the hair, or else the head."""
        if self.scene.strands is not None and len(self.scene.strands):
            return self.scene.strands.points.reshape(-1, 3)
        return torch.zeros(0, 3) if self.scene.head is None else self.scene.head.vertices

    def _welcome(self, client: "viser.ClientHandle") -> None:
        client.camera.on_update(lambda _: self._moved(client))
        self.start(client)

    def _part(self, client: "viser.ClientHandle") -> None:
        self._loop.forget(client.client_id)
        with self._lock:
            self._standing.pop(client.client_id, None)

    def _moved(self, client: "viser.ClientHandle") -> None:
        """Follow a browser's camera.

        While it is where the page has placed it, it is reframed when the window changes; once the user moves it, it is
        not.
        """
        camera, resized = self.camera_of(client), False
        with self._lock:
            standing = self._standing.get(client.client_id)
            if standing is not None:
                if camera.stands_at(standing.pose):
                    self._standing[client.client_id] = replace(standing, arrived=True)
                    resized = camera.aspect != standing.aspect
                elif standing.arrived:
                    del self._standing[client.client_id]
        if standing is not None and resized:
            self._stand(client, standing.photograph)
        else:
            self._ask(client)

    def _ask(self, client: "viser.ClientHandle") -> None:
        # viser reports movements in several threads: without the lock, one that has read an earlier camera could ask
        # last, and its picture would stay.
        with self._asking:
            self._loop.ask(client.client_id, self.request_of(client))

    def _draw(self, browser: int, request: FrameRequest, size: int) -> None:
        """Draw one picture and send it, unless the browser has disconnected meanwhile."""
        frame = frame_of(request, size)
        client = self.server.get_clients().get(browser)
        if client is None:
            return
        if frame is None:
            client.scene.set_background_image(None)
        else:
            client.scene.set_background_image(
                frame.picture, format="jpeg", jpeg_quality=JPEG_QUALITY, depth=frame.depth
            )


def frame_of(request: FrameRequest, size: int) -> Frame | None:
    """The picture of a request, with `size` pixels along its longer side; None if there is nothing to show."""
    scene, camera = request.scene, request.camera.sized(size)
    ours = None
    renderer = request.moment or scene.renderer
    if request.look.neural and renderer is not None:
        ours = rendered(renderer, camera, request.look.hides)
    if request.photograph is None or scene.photographs is None:
        return ours
    behind = Frame(np.full((camera.height, camera.width, 3), PAPER, np.uint8)) if ours is None else ours
    taken = scene.photographs.cameras[request.photograph].to("cpu")
    photograph = to_bytes(scene.photographs.image(request.photograph))
    seen = seen_by(photograph, taken, camera, behind.picture)
    return behind._replace(picture=wiped(seen, behind.picture, request.look.wipe))


def place(client: "viser.ClientHandle", pose: Pose) -> None:
    """Move a browser's camera."""
    with client.atomic():
        client.camera.up_direction = pose.up
        client.camera.position = pose.position
        client.camera.look_at = pose.look_at
        client.camera.fov = pose.field_of_view
