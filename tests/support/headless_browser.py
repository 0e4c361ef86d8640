"""A headless Chromium for tests of pages, where the machine has one."""

import contextlib
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

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

PATIENCE = 240.0
"""Seconds until something counts as never happening, on a machine that may be busy with other tests."""


@dataclass
class Tab:
    """A page in the browser.

    Attributes:
        page: playwright's.
        errors: what the page's console called an error, and exceptions of its scripts.
    """

    page: Any
    errors: list[str] = field(default_factory=list)

    def picture(self) -> np.ndarray:
        """What the page shows, RGB."""
        encoded = np.frombuffer(self.page.screenshot(), np.uint8)
        return np.ascontiguousarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR)[..., ::-1])

    def canvas(self) -> np.ndarray:
        """The part of the picture that neither the panel nor notices cover: a square in the middle."""
        picture = self.picture()
        height, width, _ = picture.shape
        side = min(height, width) // 2
        top, left = (height - side) // 2, (width - side) // 2
        return picture[top : top + side, left : left + side]

    def settled(self, seconds: float = PATIENCE, stable: float = 1.5) -> np.ndarray:
        """The canvas once it has not changed for a while."""
        return self.until(lambda _: True, seconds, stable)

    def until(
        self, accepted: Callable[[np.ndarray], bool], seconds: float = PATIENCE, stable: float = 1.5
    ) -> np.ndarray:
        """The canvas once it is accepted and has not changed for a while."""
        end, last, since = time.monotonic() + seconds, self.canvas(), time.monotonic()
        while time.monotonic() < end:
            self.page.wait_for_timeout(250)
            now = self.canvas()
            if (now != last).any():
                last, since = now, time.monotonic()
            elif time.monotonic() - since > stable and accepted(now):
                return now
        raise AssertionError(f"the page did not come to rest as expected within {seconds} s")

    def drag(self, right: int, down: int, steps: int = 8) -> None:
        """Drag the middle of the canvas by pixels."""
        size = self.page.viewport_size
        x, y = size["width"] // 2, size["height"] // 2
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

    chromium: Any

    def open(self, port: int, width: int = 900, height: int = 600) -> Tab:
        """Open the page on a port of this machine."""
        page = self.chromium.new_page(viewport={"width": width, "height": height})
        tab = Tab(page)
        page.on("console", lambda said: tab.errors.append(said.text) if said.type == "error" else None)
        page.on("pageerror", lambda error: tab.errors.append(str(error)))
        page.set_default_timeout(1000 * PATIENCE)
        page.goto(f"http://127.0.0.1:{port}/")
        page.wait_for_selector("canvas")
        return tab


@contextlib.contextmanager
def headless_browser() -> Iterator[Browser]:
    """Start Chromium; a test skips where there is none."""
    found = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )
    if found is None:
        pytest.skip("no Chromium on this machine")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=Path(found), args=FLAGS)
        try:
            yield Browser(chromium)
        finally:
            chromium.close()
