"""A headless Chromium for tests of pages, where the machine has one."""

import contextlib
import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import cv2
import numpy as np
import pytest

if TYPE_CHECKING:
    import playwright.sync_api as playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
REQUIRED = "NEURAL_STRANDS_BROWSER"
"""Environment variable that makes a missing Chromium a failure."""
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # WebGL without a graphics card.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
CANVAS_ALONE = "*:not(:has(canvas)):not(canvas) { visibility: hidden !important; }"
"""A style that hides what lies over the canvas: panels and notices."""
KEEP_NOTICES = """
window.notices = [];
new MutationObserver(() => {
  for (const { innerText } of document.querySelectorAll("[role=alert]"))
    if (!window.notices.includes(innerText)) window.notices.push(innerText);
}).observe(document, { childList: true, subtree: true, characterData: true });
"""
"""A script that remembers notices, because they vanish long before a wait ends in vain."""
HARMLESS = "Unable to preventDefault inside passive event listener"
"""Chromium prints this about viser's drags, without consequences."""
PATIENCE = 240.0
"""Seconds after which something counts as not happening, on a machine that may be busy with other tests."""
BETWEEN_LOOKS = 0.1
"""Seconds between two checks of a page."""


@dataclass
class Tab:
    """A page in the browser.

    Attributes:
        page: playwright's.
        errors: what the page's console called an error, and exceptions of its scripts.
    """

    page: "playwright.Page"
    errors: list[str] = field(default_factory=list)

    def hear(self, said: "playwright.ConsoleMessage") -> None:
        """Keep what the console calls an error."""
        if said.type == "error" and HARMLESS not in said.text:
            self.errors.append(said.text)

    def canvas(self) -> np.ndarray:
        """What lies behind the panel and the notices, RGB."""
        encoded = np.frombuffer(self.page.screenshot(style=CANVAS_ALONE), np.uint8)
        decoded = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
        assert decoded is not None
        return np.ascontiguousarray(decoded[..., ::-1])

    def until(self, accepted: Callable[[np.ndarray], bool]) -> np.ndarray:
        """The first canvas that is accepted."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            canvas = self.canvas()
            if accepted(canvas):
                return canvas
            self.page.wait_for_timeout(1000 * BETWEEN_LOOKS)
        raise AssertionError(f"the page did not show what was expected within {PATIENCE} s; {self.report()}")

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Wait until something is true, while the browser keeps running."""
        end = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > end:
                raise AssertionError(f"what was expected did not happen within {PATIENCE} s; {self.report()}")
            self.page.wait_for_timeout(1000 * BETWEEN_LOOKS)

    def wait_until_still(self, found: "playwright.Locator") -> None:
        """Wait until a control stays where it is: on a busy machine, a folder that opens moves it during a click."""
        last: object = None

        def still() -> bool:
            nonlocal last
            before, last = last, found.bounding_box()
            return last is not None and last == before

        self.wait_for(still)

    def report(self) -> str:
        """What the page says now, its notices so far, and what its console called errors: explains a wait in vain."""
        text, notices = self.page.locator("body").inner_text(), self.page.evaluate("window.notices")
        return f"the page says:\n{text}\nnotices so far: {notices}\nerrors: {self.errors}"

    def wait_for_text(self, text: str, state: Literal["visible", "detached"] = "visible") -> None:
        """Wait until the page says something, or no longer says it."""
        try:
            self.page.get_by_text(text).wait_for(state=state)
        except Exception as error:
            error.add_note(self.report())
            raise

    def fill(self, label: str, value: str) -> None:
        """Type a value into the field that stands beside a label, or beside the slider there: it has no name itself."""
        field = self.page.locator(f"xpath=//label[text()='{label}']/ancestor::*[.//input][1]//input").last
        field.fill(value)
        field.press("Enter")

    def drag(self, right: int, down: int, steps: int = 8) -> None:
        """Drag the canvas by pixels, starting where there are neither panels nor notices."""
        size = self.page.viewport_size
        assert size is not None
        x, y = size["width"] // 4, size["height"] * 2 // 3
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + right, y + down, steps=steps)
        self.page.mouse.up()


@dataclass
class Browser:
    """A running Chromium.

    Attributes:
        chromium: playwright's.
    """

    chromium: "playwright.Browser"

    def open(self, port: int, width: int = 640, height: int = 420) -> Tab:
        """Open the page on a port of this machine."""
        page = self.chromium.new_page(viewport={"width": width, "height": height})
        tab = Tab(page)
        page.add_init_script(KEEP_NOTICES)
        page.on("console", tab.hear)
        page.on("pageerror", lambda error: tab.errors.append(str(error)))
        page.set_default_timeout(1000 * PATIENCE)
        page.goto(f"http://127.0.0.1:{port}/")
        page.wait_for_selector("canvas[data-engine]")  # three.js marks its own; the chart of a fit is another
        return tab


@contextlib.contextmanager
def headless_browser() -> Iterator[Browser]:
    """Start Chromium; where there is none, a test skips, or fails if one is required."""
    found = next((path for name in NAMES if (path := shutil.which(name))), None)
    if found is None:
        give_up = pytest.fail if REQUIRED in os.environ else pytest.skip
        give_up(f"no Chromium on this machine: none of {', '.join(NAMES)} is on the path")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=Path(found), args=FLAGS, timeout=1000 * PATIENCE)
        try:
            yield Browser(chromium)
        finally:
            chromium.close()
