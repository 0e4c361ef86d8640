"""The controls of wind, as browsers set them: several threads at once, on a machine that may be slow."""

import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from viser import GuiEvent

from neural_strands.editing.settings import Wind
from neural_strands.runs.newest_model import newest_state
from neural_strands.runs.run_folder import RunFolder
from neural_strands.viewer.open_scene import open_run
from neural_strands.viewer.page import Page
from neural_strands.viewer.panels.wind import add_wind_panel
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server


class QuietPage(Page):
    """A page that draws nothing, whose edits take their time."""

    def __init__(self, server, scene):
        self.server, self.scene, self.moments, self.edits = server, scene, [], []

    def show_moment(self, moment):
        self.moments.append(moment)

    def do(self, _event, _doing, edit):
        wanted = edit()
        time.sleep(0.05)
        self.edits.append(wanted)
        self.scene = self.scene.with_edits((wanted,))


@pytest.fixture
def page(tiny_run):
    server = start_server(LOOPBACK, 0)
    yield QuietPage(server, open_run(tiny_run, newest_state(RunFolder(tiny_run)), torch.device("cpu")))
    stop_server(server)


def browser() -> Any:
    notice = SimpleNamespace(remove=lambda: None, body="")
    return SimpleNamespace(add_notification=lambda *_, **__: notice)


class Controls:
    """The controls by their labels, set as a browser sets them: each change on a thread of its own."""

    def __init__(self, page):
        add_wind_panel(page, page.do)
        self._handles = {handle.label: handle for handle in page.server.gui._gui_input_handle_from_uuid.values()}
        self._threads = []

    def __getitem__(self, label):
        return self._handles[label].value

    def set(self, label, value):
        handle = self._handles[label]
        handle._impl.value = value
        for answer in handle._impl.update_cb:
            self._threads.append(threading.Thread(target=answer, args=(GuiEvent(browser(), 0, handle),)))
            self._threads[-1].start()

    def wait(self):
        for thread in self._threads:
            thread.join(60)
            assert not thread.is_alive()


def wait_until(condition):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_changes_while_the_wind_starts_leave_one_wind_which_ends_when_it_is_undone(page):
    still, controls = page.scene, Controls(page)
    controls.set("Play the wind", True)
    for strength in (2.0, 3.0, 4.0):
        controls.set("Strength", strength)
    controls.wait()
    assert controls["Play the wind"]
    assert page.scene.edits == (Wind(strength=4.0),)
    assert len([thread for thread in threading.enumerate() if thread.name == "viewer-wind"]) == 1
    page.scene = still
    wait_until(lambda: not controls["Play the wind"])
    wait_until(lambda: page.moments[-1] is None)
    # Nothing comes back.
    time.sleep(0.2)
    assert not controls["Play the wind"]
    assert page.scene is still
    assert page.moments[-1] is None


def test_a_change_that_is_late_does_not_bring_back_wind_that_was_undone(page):
    still, controls = page.scene, Controls(page)
    controls.set("Play the wind", True)
    controls.wait()
    page.scene = still
    wait_until(lambda: not controls["Play the wind"])
    controls.set("Strength", 3.0)
    controls.wait()
    assert page.scene is still
    assert not controls["Play the wind"]


def test_wind_blows_and_rests_as_often_as_the_box_is_ticked(page):
    controls = Controls(page)
    for _ in range(3):
        for ticked in (True, False):
            controls.set("Play the wind", ticked)
        controls.wait()
    controls.set("Play the wind", True)
    controls.wait()
    assert controls["Play the wind"]
    wait_until(lambda: page.moments and page.moments[-1] is not None)
    controls.set("Play the wind", False)
    controls.wait()
    assert page.moments[-1] is None


def test_simulated_wind_goes_on_by_small_steps_however_long_they_take(page):
    controls = Controls(page)
    controls.set("Simulate", True)
    controls.set("Play the wind", True)
    wait_until(lambda: len(page.moments) >= 3)
    controls.set("Play the wind", False)
    controls.wait()
    assert page.scene.edits[0].simulate
    first, second = (moment.strands.points for moment in page.moments[:2])
    assert float((first[:, 0] - second[:, 0]).abs().max()) == 0.0
