"""The page in a real browser: what it shows is what the renderer draws for its camera."""

import os
import re
from dataclasses import dataclass, replace

import cv2
import numpy as np
import pytest
import torch
from headless_browser import REQUIRED, Browser, Tab, headless_browser
from tiny_capture import tiny_config

from neural_strands.editing.edit_list import read_edits
from neural_strands.editing.settings import Haircut
from neural_strands.foundation.progress import Feedback
from neural_strands.grooms.io import read_groom
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.viewer.beside import page_beside
from neural_strands.viewer.page import FrameRequest, picture_of
from neural_strands.viewer.serve import ServedPage
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server

pytestmark = [
    pytest.mark.slow,
    # Chromium without a graphics card needs both cores of a small machine for minutes.
    pytest.mark.skipif(REQUIRED not in os.environ, reason="the page in a browser: run `make browser`"),
]

PIXELS = 256
"""Longer side of the finest pictures: small, because the machine may be busy."""
SMALL = (90, 60)
"""Width and height at which pictures are compared, so that neither JPEG nor the size that was drawn counts."""
ALIKE = 0.3
"""Mean difference of pictures of one thing, of 255 levels."""
APART = 1.0
"""Mean difference of pictures of different things."""


@dataclass
class Watched:
    """A tab, and the page behind it, which says what the tab has to show."""

    served: ServedPage
    tab: Tab
    browser: int
    last_request: FrameRequest | None = None
    last_picture: np.ndarray | None = None

    @property
    def page(self):
        return self.tab.page

    def drawn(self):
        """The finest picture that the renderer draws for the tab's camera."""
        client = self.served.page.server.get_clients()[self.browser]
        request = self.served.page.request_of(client)
        if request != self.last_request:
            self.last_request, self.last_picture = request, picture_of(request, PIXELS)
        assert self.last_picture is not None
        return self.last_picture

    def shown(self):
        """The canvas, once it shows what the renderer draws now; the camera may still be moving."""
        return self.tab.until(lambda canvas: difference(canvas, self.drawn()) < ALIKE)

    def cut(self, way, control, value):
        """Cut the hair with one of the ways of the panel."""
        self.page.get_by_role("tab", name="Edit").click()
        self.page.get_by_role("combobox", name="Cut").click()
        self.page.get_by_role("option", name=way).click()
        self.tab.fill(control, value)
        self.page.get_by_role("button", name="Cut the hair").click()


@pytest.fixture
def served(tiny_run):
    server = start_server(LOOPBACK, 0)
    served = ServedPage(server, tiny_run, torch.device("cpu"), finer=(PIXELS,))
    yield served
    stop_server(server)
    served.close()


@pytest.fixture(scope="module")
def browser():
    with headless_browser() as opened:
        yield opened


@pytest.fixture
def watch(served, browser: Browser):
    """Opens the page in a tab and waits until it shows hair."""
    server = served.page.server
    opened = []

    def make(width=640, height=420):
        known = set(server.get_clients())
        tab = browser.open(server.get_port(), width, height)
        tab.wait_for(lambda: bool(server.get_clients().keys() - known))
        (client,) = server.get_clients().keys() - known
        opened.append(Watched(served, tab, client))
        assert opened[-1].shown().std() > 10, "the ball of the head lies in the middle, with dark hair on it"
        return opened[-1]

    yield make
    for watched in opened:
        watched.page.close()


def difference(a, b):
    """Mean difference of two pictures, in levels."""
    small = [cv2.resize(each.astype(np.float32), SMALL, interpolation=cv2.INTER_AREA) for each in (a, b)]
    return float(np.abs(small[0] - small[1]).mean())


def test_a_page_shows_hair_and_turns(watch):
    tab = watch()
    front = tab.shown()
    tab.tab.drag(120, 30)
    tab.tab.wait_for(lambda: difference(front, tab.drawn()) > APART)
    tab.shown()
    tab.page.get_by_text("Face in front").click()
    tab.tab.until(lambda canvas: difference(front, canvas) < ALIKE)
    assert tab.tab.errors == []


def test_two_browsers_have_a_camera_each_and_share_the_rest(watch):
    one, other = watch(), watch(600, 480)
    first, second = one.shown(), other.shown()
    one.tab.drag(120, 0)
    one.tab.wait_for(lambda: difference(first, one.drawn()) > APART)
    one.shown()
    assert difference(second, other.shown()) < ALIKE
    one.page.get_by_label("Rendered hair").click()
    for tab in (one, other):
        tab.tab.until(lambda canvas: canvas.mean() > 230)
    one.page.close()
    other.page.get_by_label("Rendered hair").click()
    other.tab.until(lambda canvas: difference(second, canvas) < ALIKE)
    assert one.tab.errors == other.tab.errors == []


def test_hair_is_cut_and_the_cut_undone_and_the_result_saved(watch, tmp_path):
    tab = watch()
    before = tab.shown()
    tab.cut("to a length", "Length, cm", "15")
    tab.page.get_by_text("haircut: length 0.15").wait_for()
    tab.cut("by a share", "Share cut off", "0.6")
    tab.page.get_by_text("haircut: fraction 0.6").wait_for()
    assert difference(before, tab.drawn()) > APART
    tab.shown()
    tab.page.get_by_role("tab", name="Save").click()
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name="Save the edits").click()
    download.value.save_as(tmp_path / "edits.json")
    assert [type(edit) for edit in read_edits(tmp_path / "edits.json")] == [Haircut, Haircut]
    with tab.page.expect_download() as download:
        tab.page.get_by_role("button", name="Save the hair").click()
    download.value.save_as(tmp_path / "hair.usd")
    assert len(read_groom(tmp_path / "hair.usd")) == 200
    tab.page.get_by_role("tab", name="Edit").click()
    tab.page.get_by_text("Undo", exact=True).click()
    tab.page.get_by_text("haircut: fraction 0.6").wait_for(state="detached")
    tab.tab.until(lambda canvas: difference(before, canvas) < ALIKE)
    assert tab.tab.errors == []


def test_an_error_is_one_sentence_on_the_page(watch):
    tab = watch()
    tab.cut("by a share", "Share cut off", "1")
    tab.page.get_by_text("expected hair to remain").wait_for()
    assert tab.tab.errors == []


def test_a_painted_region_is_restyled_alone(watch):
    tab = watch()
    fitted = tab.served.page.scene.strands.points
    tab.page.get_by_role("tab", name="Edit").click()
    tab.page.get_by_text("Region", exact=True).click()
    tab.page.get_by_label("Paint", exact=True).click()
    tab.tab.fill("Brush, cm", "2")
    painted = tab.page.get_by_text("that grow in the painted region")

    def clicked() -> bool:
        # Left of the panel, below the notices, on the upper half of the ball of the head.
        tab.page.mouse.click(290, 165)
        tab.page.wait_for_timeout(2000)
        return painted.is_visible()

    tab.tab.wait_for(clicked)
    tab.page.get_by_text("Restyle", exact=True).click()
    tab.tab.fill("Length, times", "0.5")
    tab.page.get_by_role("button", name="Restyle the hair").click()
    tab.page.get_by_text("restyle: length 0.5").wait_for()
    moved = (tab.served.page.scene.strands.points - fitted).norm(dim=-1).amax(dim=1)
    assert 0.01 < float((moved > 0.005).float().mean()) < 0.5
    tab.shown()
    assert tab.tab.errors == []


def test_wind_moves_the_hair_until_it_is_undone(watch):
    tab = watch()
    still = tab.shown()
    tab.page.get_by_role("tab", name="Edit").click()
    tab.page.get_by_text("Wind", exact=True).click()
    tab.tab.fill("Strength", "5")
    blow = tab.page.get_by_label("Blow")
    blow.click()
    tab.page.get_by_text("wind: strength 5").wait_for()
    tab.tab.until(lambda canvas: difference(still, canvas) > APART)
    assert blow.is_checked()
    tab.page.get_by_text("Undo", exact=True).click()
    tab.page.get_by_text("wind: strength 5").wait_for(state="detached")
    tab.tab.wait_for(lambda: not blow.is_checked())
    tab.tab.until(lambda canvas: difference(still, canvas) < ALIKE)
    assert tab.tab.errors == []


def test_in_a_narrow_window_the_hair_and_the_controls_are_there(watch):
    tab = watch(390, 720)
    tab.page.get_by_role("tab", name="Edit").click()
    tab.page.get_by_role("button", name="Cut the hair").scroll_into_view_if_needed()
    box = tab.page.get_by_role("button", name="Cut the hair").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390
    assert tab.tab.errors == []


def test_a_page_beside_a_fit_waits_for_it_and_shows_it(tiny_run, browser, tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    with page_beside(tmp_path / "run"):
        said = ""
        while "open http" not in said:
            said += capfd.readouterr().err
        tab = browser.open(int(re.search(r"open http://127.0.0.1:(\d+)", said)[1]))
        tab.page.get_by_text("Waiting for a fit in run").wait_for()
        request = FitRequest(tiny_run.parent / "ball", tmp_path / "run", segments=tiny_run.parent / "segments.npz")
        run_fit(request, replace(tiny_config(), steps=6), torch.device("cpu"), Feedback())
        tab.page.get_by_role("tab", name="Fit").click()
        tab.page.get_by_text("Step 6 of 6").wait_for()
        tab.until(lambda canvas: canvas.std() > 10)
        assert tab.errors == []
        tab.page.close()
