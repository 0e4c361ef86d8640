"""What a page asks for, and what is in the picture that it gets."""

import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from neural_strands.model.picture_depth import picture_depth
from neural_strands.runs.newest_model import newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.cameras import PageCamera
from neural_strands.viewer.layers import HEAD
from neural_strands.viewer.open_scene import open_run
from neural_strands.viewer.page import PAPER, FrameRequest, Look, Page, frame_of
from neural_strands.viewer.scene import Scene

HALF_TURN = (0.0, 1.0, 0.0, 0.0)
"""The rotation of a camera that looks along -z, with y up."""


@pytest.fixture(scope="module")
def request_of_front(tiny_run):
    scene = open_run(tiny_run, newest_state(RunFolder(tiny_run)), torch.device("cpu"))
    return FrameRequest(PageCamera(HALF_TURN, (0.0, 0.0, 0.7), 0.4, 1.5), scene, Look())


def test_a_picture_has_a_depth_only_if_it_hides_something(request_of_front):
    assert frame_of(request_of_front, 48).depth is None
    seen = replace(request_of_front, look=Look(objects=frozenset({HEAD})))
    frame = frame_of(seen, 48)
    assert frame.picture.shape == (32, 48, 3)
    expected = picture_depth(seen.scene.renderer.render(seen.camera.sized(48)))
    np.testing.assert_array_equal(frame.depth, expected.numpy())
    # Marks on the scalp are seen through the hair.
    assert frame_of(replace(seen, look=replace(seen.look, painting=True)), 48).depth is None


def test_nothing_is_drawn_and_hidden_without_rendered_hair(request_of_front):
    hidden = replace(request_of_front, look=Look(neural=False, objects=frozenset({HEAD})))
    assert frame_of(hidden, 48) is None
    # A photograph alone hides nothing, because its depth is unknown.
    beside = frame_of(replace(hidden, photograph=0, look=replace(hidden.look, wipe=0.5)), 48)
    assert beside.depth is None
    assert (beside.picture[:, 30:] == PAPER).all()


def test_the_newest_camera_is_asked_for_last(tiny_run, monkeypatch):
    """viser reports each movement on a thread of its own; here the first one is slow after it has read its camera."""
    clients: dict[int, Any] = {}
    server: Any = SimpleNamespace(
        scene=SimpleNamespace(set_up_direction=lambda _: None),
        get_clients=lambda: clients,
        on_client_connect=lambda _: None,
        on_client_disconnect=lambda _: None,
    )
    reads, proceed = threading.Event(), threading.Event()

    class SlowFirst(Page):
        def camera_of(self, client):
            read = super().camera_of(client)
            if not reads.is_set():
                reads.set()
                proceed.wait(0.5)
            return read

    page = SlowFirst(server, Scene(tiny_run, "run"))
    camera = SimpleNamespace(wxyz=HALF_TURN, position=(0.0, 0.0, 0.7), fov=0.4, aspect=1.5)
    client: Any = SimpleNamespace(client_id=0, camera=camera)
    asked: list[FrameRequest] = []
    monkeypatch.setattr(page._loop, "ask", lambda _, request: asked.append(request))
    first = threading.Thread(target=page._ask, args=(client,))
    first.start()
    assert reads.wait(60)
    camera.position = (0.0, 0.0, 0.9)
    second = threading.Thread(target=page._ask, args=(client,))
    second.start()
    second.join(0.2)
    proceed.set()
    for thread in (first, second):
        thread.join(60)
    page.close()
    assert [request.camera.position[2] for request in asked] == [0.7, 0.9]
