"""The page in a real browser. They need a quiet machine with Chromium and run when asked for (`make browser`)."""

import os

import numpy as np
import pytest
import torch
from headless_browser import headless_browser

from neural_strands.editing.edit_list import read_edits
from neural_strands.editing.settings import Haircut
from neural_strands.grooms.io import read_groom
from neural_strands.viewer.serve import ServedPage
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("NEURAL_STRANDS_BROWSER" not in os.environ, reason="NEURAL_STRANDS_BROWSER=1 runs Chromium"),
]


@pytest.fixture
def port(tiny_run):
    server = start_server(LOOPBACK, 0)
    served = ServedPage(server, tiny_run, torch.device("cpu"))
    yield server.get_port()
    stop_server(server)
    served.close()


@pytest.fixture(scope="module")
def browser():
    with headless_browser() as opened:
        yield opened


def difference(a, b):
    return float(np.abs(a.astype(int) - b.astype(int)).mean())


def shows_hair(canvas):
    """The ball of the head lies in the middle, with dark hair on it."""
    return canvas.std() > 10


def test_a_page_shows_hair_and_turns(port, browser):
    tab = browser.open(port)
    front = tab.until(shows_hair)
    tab.drag(120, 30)
    turned = tab.settled()
    assert difference(front, turned) > 2.0
    assert shows_hair(turned)
    tab.page.get_by_text("Face in front").click()
    again = tab.settled()
    assert difference(front, again) < difference(front, turned) / 2
    assert tab.errors == []


def test_two_browsers_have_a_camera_each_and_share_the_rest(port, browser):
    one, other = browser.open(port), browser.open(port, 500, 800)
    first, second = one.until(shows_hair), other.until(shows_hair)
    one.drag(150, 0)
    assert difference(first, one.settled()) > 2.0
    assert difference(second, other.settled()) < 1.0
    one.page.get_by_label("Rendered hair").click()
    assert one.until(lambda canvas: canvas.mean() > 230).mean() > 230
    assert difference(second, other.settled()) > 2.0
    one.page.close()
    other.page.get_by_label("Rendered hair").click()
    assert difference(second, other.settled()) < 1.0
    assert one.errors == other.errors == []


def test_hair_is_cut_and_the_cut_undone_and_the_result_saved(port, browser, tmp_path):
    tab = browser.open(port)
    before = tab.until(shows_hair)
    tab.page.get_by_role("tab", name="Edit").click()
    tab.page.get_by_role("combobox", name="Cut").click()
    tab.page.get_by_role("option", name="to a length").click()
    tab.page.get_by_role("button", name="Cut the hair").click()
    tab.page.get_by_text("haircut: length 0.15").wait_for()
    tab.page.get_by_role("combobox", name="Cut").click()
    tab.page.get_by_role("option", name="by a share").click()
    tab.page.get_by_role("button", name="Cut the hair").click()
    tab.page.get_by_text("haircut: fraction 0.3").wait_for()
    cut = tab.settled()
    assert difference(before, cut) > 1.0
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
    tab.page.get_by_text("haircut: fraction 0.3").wait_for(state="detached")
    assert difference(before, tab.settled()) < difference(before, cut) / 2
    assert tab.errors == []


def test_an_error_is_one_sentence_on_the_page(port, browser):
    tab = browser.open(port)
    tab.until(shows_hair)
    tab.page.get_by_role("tab", name="Edit").click()
    tab.page.get_by_role("combobox", name="Cut").click()
    tab.page.get_by_role("option", name="by a share").click()
    tab.page.get_by_role("textbox", name="Share cut off").fill("1")
    tab.page.get_by_role("textbox", name="Share cut off").press("Enter")
    tab.page.get_by_role("button", name="Cut the hair").click()
    tab.page.get_by_text("expected hair to remain").wait_for()
    assert tab.errors == []
