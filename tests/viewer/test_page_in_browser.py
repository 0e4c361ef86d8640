"""The page in a real browser: what it shows is what the renderer draws for its camera, whatever is done to the hair.

All tests share one browser, one server and one tab, because each costs seconds; before a test the page is put back to
how it began. Nothing waits for a time to pass, only for what is to happen.
"""

import re
import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from headless_browser import PATIENCE, Browser, headless_browser
from tiny_capture import tiny_config
from watched_page import ALIKE, PIXELS, WINDOW, Watched, difference

from neural_strands.editing.edit_list import read_edits
from neural_strands.editing.settings import Blend, Density, Haircut, Sample, Transfer, Wind
from neural_strands.foundation.progress import Feedback
from neural_strands.geometry.strands import lengths
from neural_strands.grooms.io import read_groom
from neural_strands.model.files import find_hair_model, load_hair_model, save_hair_model
from neural_strands.runs.run_fit import FitRequest, run_fit
from neural_strands.viewer.beside import page_beside
from neural_strands.viewer.history import History
from neural_strands.viewer.page import Look
from neural_strands.viewer.panels.plane_handle import HANDLE
from neural_strands.viewer.panels.plane_handle import NAME as PLANE
from neural_strands.viewer.panels.region import BRUSH
from neural_strands.viewer.panels.tabs import Tabs
from neural_strands.viewer.serve import ServedPage
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server

pytestmark = pytest.mark.slow

APART = 1.0
"""Mean difference of pictures of different things."""
DARK = 80
"""Level below which a pixel shows hair; skin and background are lighter."""


@pytest.fixture(scope="module")
def browser():
    with headless_browser() as opened:
        yield opened


@pytest.fixture(scope="module")
def served(browser, tiny_run):
    server = start_server(LOOPBACK, 0)
    served = ServedPage(server, tiny_run, torch.device("cpu"), finer=(PIXELS,))
    yield served
    stop_server(server)
    served.close()


def watched(served: ServedPage, browser: Browser, size=WINDOW):
    """The page in a tab of its own, once it shows hair."""
    server = served.page.server
    known = set(server.get_clients())
    tab = browser.open(server.get_port(), *size)
    tab.wait_for(lambda: bool(server.get_clients().keys() - known))
    (client,) = server.get_clients().keys() - known
    found = Watched(served, tab, client)
    assert found.shown().std() > 10, "the ball of the head lies in the middle, with dark hair on it"
    return found


@pytest.fixture(scope="module")
def first(served, browser):
    tab = watched(served, browser)
    # viser says that there is no graphics card, in a corner of the canvas.
    tab.page.get_by_text("Software WebGL").locator("xpath=ancestor::*[.//button][1]//button").click()
    return tab


@pytest.fixture
def tab(first):
    """The tab, with the page as it was when it was opened; whatever a test does, the console stays without errors."""
    page = first.served.page
    first.tab.errors.clear()
    first.page.set_viewport_size({"width": WINDOW[0], "height": WINDOW[1]})
    page.server.scene.reset()
    page.edit(lambda _: History())
    page.set_look(Look())
    Tabs(page)
    page.start(first.client)
    first.shown()
    yield first
    assert first.tab.errors == []


@pytest.fixture
def other(tiny_run, tmp_path):
    """Another run's model: strands that hang elsewhere."""
    model = load_hair_model(find_hair_model(tiny_run))
    with torch.no_grad():
        model.textures.shape.copy_(model.textures.shape.flip(0) * 0.5)
    save_hair_model(model, tmp_path / "other", {})
    return tmp_path / "other"


def test_a_page_shows_hair_and_turns(tab):
    front = tab.shown()
    tab.tab.drag(120, 30)
    tab.tab.wait_for(lambda: difference(front, tab.drawn()) > APART)
    tab.shown()
    tab.press("Front view")
    tab.tab.until(lambda canvas: difference(front, canvas) < ALIKE)


def test_the_head_is_drawn_behind_the_hair(tab):
    size = tab.shown().shape[1::-1]
    before = cv2.resize(tab.drawn().astype(float), size)
    camera = tab.served.page.camera_of(tab.client).sized(max(WINDOW))
    output = tab.scene.renderer.render(camera)
    factor = tab.scene.renderer.model.config.supersample
    parts = (output.body_depth[::factor, ::factor].isfinite(), output.alpha < 0.1)
    # A window's height may differ from that of its camera by a pixel.
    on_head, bare = (cv2.resize(part.numpy().astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) for part in parts)
    hair = (on_head > 0) & (before.mean(axis=2) < DARK)
    # Away from the hair, because the picture has fewer pixels than the window.
    skin = cv2.erode(on_head & bare, np.ones((7, 7))) > 0
    assert min(hair.sum(), skin.sum()) > 1000

    def change(canvas, part):
        return np.abs(canvas[part] - before[part]).mean()

    tab.page.get_by_label("Head", exact=True).click()
    tab.tab.until(lambda canvas: change(canvas, skin) > 20 and change(canvas, hair) < 15)
    tab.page.get_by_label("Rendered hair").click()
    # Now nothing hides the head.
    tab.tab.until(lambda canvas: change(canvas, hair) > 50)
    tab.page.get_by_label("Rendered hair").click()
    tab.page.get_by_label("Head", exact=True).click()
    tab.shown()


def test_two_browsers_have_a_camera_each_and_share_the_rest(tab, served, browser):
    guest = watched(served, browser, (700, 480))
    ours, theirs = tab.shown(), guest.shown()
    tab.tab.drag(120, 0)
    tab.tab.wait_for(lambda: difference(ours, tab.drawn()) > APART)
    tab.shown()
    assert difference(theirs, guest.shown()) < ALIKE
    guest.page.get_by_label("Rendered hair").click()
    for each in (tab, guest):
        each.tab.until(lambda canvas: canvas.mean() > 230)
    # One of them leaves; the other goes on.
    guest.page.close()
    tab.tab.wait_for(lambda: guest.browser not in served.page.server.get_clients())
    tab.page.get_by_label("Rendered hair").click()
    tab.shown()
    assert guest.tab.errors == []


def test_hair_is_cut_and_the_cut_undone_and_the_result_saved(tab, tmp_path):
    before = tab.shown()
    tab.cut("to a length", "Length (cm)", "15")
    tab.says("haircut: length 0.15")
    tab.cut("by a fraction", "Fraction cut off", "0.6")
    tab.says("haircut: fraction 0.6")
    assert difference(before, tab.drawn()) > APART
    tab.shown()
    tab.open("Save")
    tab.download("Save the edits").save_as(tmp_path / "edits.json")
    assert [type(edit) for edit in read_edits(tmp_path / "edits.json")] == [Haircut, Haircut]
    tab.download("Save the hair").save_as(tmp_path / "hair.usd")
    saved = read_groom(tmp_path / "hair.usd")
    assert saved.lengths() == pytest.approx(lengths(tab.scene.strands.points), abs=1e-4)
    tab.tab.fill("Longer side (pixels)", str(PIXELS))
    tab.download("Save this view").save_as(tmp_path / "view.png")
    assert np.array_equal(cv2.imread(str(tmp_path / "view.png"))[..., ::-1], tab.rendered())
    tab.open("Edit")
    tab.undo("haircut: fraction 0.6")
    tab.tab.until(lambda canvas: difference(before, canvas) < ALIKE)
    tab.page.get_by_text("Redo", exact=True).click()
    tab.says("haircut: fraction 0.6")
    tab.tab.until(lambda canvas: difference(before, canvas) > APART)


def test_hair_below_the_plane_is_cut(tab):
    tab.open("Edit")
    whole = float(lengths(tab.scene.strands.points).sum())
    tab.page.get_by_label("Show the plane").click()
    tab.tab.wait_for(lambda: tab.served.page.server.scene.get_handle_by_name(PLANE) is not None)
    plane = tab.served.page.server.scene.get_handle_by_name(PLANE)
    low = plane.position.copy()
    # Near the tip of the arrow that points up.
    x, y = tab.pixel(torch.from_numpy(low).float() + torch.tensor([0.0, 0.85 * HANDLE, 0.0]))
    tab.tab.until(lambda canvas: np.ptp(canvas[round(y), round(x)].astype(int)) > 40)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x, y - 20, steps=6)
    tab.page.mouse.up()
    tab.tab.wait_for(lambda: plane.position[1] > low[1] + 0.005)
    tab.press("Cut the hair")
    tab.says("haircut: plane")
    (cut,) = tab.scene.edits
    assert cut.plane[1] > low[1] + 0.005
    assert float(tab.scene.strands.points[..., 1].min()) > cut.plane[1] - 1e-3
    assert float(lengths(tab.scene.strands.points).sum()) < 0.99 * whole
    tab.page.get_by_label("Show the plane").click()
    tab.shown()


def test_an_error_is_one_sentence_on_the_page(tab):
    tab.cut("by a fraction", "Fraction cut off", "1")
    tab.says("expected hair to remain")
    tab.open("Edit", "Another run")
    tab.press("Mix the hairstyles")
    tab.says("expected its folder, found an empty field")
    assert tab.scene.edits == ()


def test_a_painted_region_is_restyled_alone(tab):
    fitted = tab.scene.strands.points
    tab.open("Edit", "Region")
    tab.page.get_by_label("Paint", exact=True).click()
    tab.tab.fill("Brush radius (cm)", "2")
    roots = fitted[:, 0]
    tab.page.mouse.click(*tab.pixel(roots[roots[:, 2].argmax()]))
    tab.says("that grow in the painted region")
    clicked, view = tab.painted(), tab.served.page.camera_of(tab.client)
    # The ball paints where it is dragged, and the head does not turn.
    ball = tab.served.page.server.scene.get_handle_by_name(BRUSH)
    x, y = tab.pixel(torch.from_numpy(ball.position).float())
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x - 50, y + 15, steps=6)
    tab.page.mouse.up()
    tab.tab.wait_for(lambda: tab.painted() > clicked)
    assert tab.served.page.camera_of(tab.client) == view
    tab.open("Edit", "Restyle")
    tab.tab.fill("Length factor", "0.5")
    tab.press("Restyle the hair")
    tab.says("restyle: length 0.5 in the painted region")
    moved = (tab.scene.strands.points - fitted).norm(dim=-1).amax(dim=1)
    assert 0.01 < float((moved > 0.005).float().mean()) < 0.5
    tab.press("Clear the region")
    tab.says("change all of the hair")
    tab.page.get_by_label("Paint", exact=True).click()
    # Neither dots nor ball lie before the picture any more.
    tab.shown()


@pytest.mark.parametrize("simulated", [False, True], ids=["quick", "simulated"])
def test_wind_moves_the_hair_until_it_is_undone(tab, simulated):
    still = tab.shown()
    tab.open("Edit", "Wind")
    tab.tab.fill("Strength", "5")
    if simulated:
        tab.page.get_by_label("Simulate").click()
    blow = tab.page.get_by_label("Play the wind")
    blow.click()
    tab.says("wind: strength 5")
    tab.tab.until(lambda canvas: difference(still, canvas) > APART)
    assert tab.scene.edits == (Wind(strength=5.0, simulate=simulated),)
    assert blow.is_checked()
    tab.undo("wind: strength 5")
    tab.tab.wait_for(lambda: not blow.is_checked())
    tab.tab.until(lambda canvas: difference(still, canvas) < ALIKE)


def test_other_shapes_are_mixed_in_and_grown(tab, other):
    before, strands = tab.shown(), tab.scene.strands
    tab.open("Edit", "Another run")
    tab.tab.fill("Other run", str(other))
    tab.press("Use the other hairstyle")
    tab.says("transfer")
    assert difference(before, tab.shown()) > APART
    tab.undo("transfer")
    tab.press("Mix the hairstyles")
    tab.says("blend")
    tab.open("Edit", "New hairstyle")
    tab.press("Make this hairstyle")
    tab.says("sample")
    tab.open("Edit", "Number of strands")
    tab.tab.fill("Strands", "120")
    tab.press("Change the number")
    tab.says("density: strands 120")
    assert [type(edit) for edit in tab.scene.edits] == [Blend, Sample, Density]
    tab.shown()
    for listed in ("density", "sample", "blend"):
        tab.undo(listed)
    assert tab.scene.strands.points.equal(strands.points)
    assert Transfer not in map(type, tab.scene.edits)


def test_a_photograph_is_compared_with_its_rendering(tab):
    tab.open("Photos")
    tab.press("Look from there")
    half = tab.shown()
    tab.tab.fill("Photograph | rendering", "1")
    assert difference(half, tab.shown()) > APART


def test_in_a_narrow_window_the_hair_and_the_controls_are_there(tab):
    tab.page.set_viewport_size({"width": 390, "height": 720})
    tab.shown()
    tab.open("Edit")
    button = tab.page.get_by_role("button", name="Cut the hair")
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 390


def test_a_page_beside_a_fit_waits_for_it_and_shows_it(tiny_run, browser, tmp_path, capfd, monkeypatch):
    monkeypatch.setenv("NEURAL_STRANDS_WEIGHTS", str(tmp_path / "none"))
    with page_beside(tmp_path / "run"):
        said, end = "", time.monotonic() + PATIENCE
        while "open http" not in said:
            assert time.monotonic() < end, said
            time.sleep(0.1)
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
