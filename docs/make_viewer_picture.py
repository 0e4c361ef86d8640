"""Photograph the page of a run, before and after a haircut at a plane, side by side.

    PYTHONPATH=tests/support python docs/make_viewer_picture.py RUN            # docs/pictures/viewer.png

RUN is the run of `neural-strands demo`. Needs Chromium and the extras `dev` and `view`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import torch
import tyro
from headless_browser import Tab, headless_browser

from neural_strands.viewer.serve import ServedPage
from neural_strands.viewer.server import LOOPBACK, start_server, stop_server

ROOT = Path(__file__).resolve().parents[1]
WINDOW, SIZE = (1050, 630), (700, 420)
"""Width and height of the window, and of one picture of it."""
DRAG = (-60, 15)
"""Pixels by which the camera is dragged before the first picture."""
REST_SECONDS = 3.0
"""Time in which a page that rests does not change, seconds."""
GAP = 8
"""White pixels between the two pictures."""


@dataclass(frozen=True)
class Arguments:
    """Options of the program."""

    run: Annotated[Path, tyro.conf.Positional]
    """The run to show."""
    out: Path = ROOT / "docs" / "pictures" / "viewer.png"
    """File of the picture."""


def at_rest(tab: Tab) -> np.ndarray:
    """The window, panel included, once it no longer changes: BGR, in the size of the picture."""
    tab.page.mouse.move(1, WINDOW[1] - 1)  # A hint shows where the mouse rests.
    before = b""
    while True:
        tab.page.wait_for_timeout(1000 * REST_SECONDS)
        now = tab.page.screenshot()
        if now == before:
            picture = cv2.imdecode(np.frombuffer(now, np.uint8), cv2.IMREAD_COLOR)
            assert picture is not None
            return cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA)
        before = now


def main(arguments: Arguments) -> None:
    """Open the page, cut the hair and write the picture."""
    server = start_server(LOOPBACK, 0)
    served = ServedPage(server, arguments.run, torch.device("cpu"))
    try:
        with headless_browser() as browser:
            tab = browser.open(server.get_port(), *WINDOW)
            tab.page.get_by_text("Software WebGL").locator("xpath=ancestor::*[.//button][1]//button").click()
            at_rest(tab)
            tab.drag(*DRAG)
            tab.page.get_by_role("tab", name="Edit").click()
            tab.page.get_by_label("Show the plane").click()
            before = at_rest(tab)
            tab.page.get_by_role("button", name="Cut the hair").click()
            tab.page.get_by_text("haircut: plane").wait_for()
            tab.page.get_by_label("Show the plane").click()
            after = at_rest(tab)
        gap = np.full((SIZE[1], GAP, 3), 255, np.uint8)
        cv2.imwrite(str(arguments.out), np.hstack([before, gap, after]))
    finally:
        stop_server(server)
        served.close()


if __name__ == "__main__":
    main(tyro.cli(Arguments))
