"""A page of the viewer in a browser's tab, and what it should show."""

import re
from dataclasses import dataclass

import cv2
import numpy as np
from headless_browser import Tab

from neural_strands.viewer.page import JPEG_QUALITY, FrameRequest, frame_of
from neural_strands.viewer.serve import ServedPage

PIXELS = 256
"""Longer side of the finest pictures: small, because the machine may be busy."""
WINDOW = (760, 460)
"""Width and height of a window: the panel covers the right half of a narrower one."""
SMALL = (90, 60)
"""Width and height at which pictures are compared, so that the size that was drawn does not count."""
ALIKE = 0.4
"""Mean difference of pictures of one thing, of 255 levels."""


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

    @property
    def scene(self):
        return self.served.page.scene

    @property
    def client(self):
        """viser's side of the tab."""
        return self.served.page.server.get_clients()[self.browser]

    def rendered(self):
        """The finest picture that the renderer draws for the tab's camera."""
        return frame_of(self.served.page.request_of(self.client), PIXELS).picture

    def drawn(self):
        """The same picture, as it is sent."""
        request = self.served.page.request_of(self.client)
        if request != self.last_request:
            picture = frame_of(request, PIXELS).picture
            _, sent = cv2.imencode(".jpg", picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))
            self.last_request, self.last_picture = request, cv2.imdecode(sent, cv2.IMREAD_COLOR)[..., ::-1]
        assert self.last_picture is not None
        return self.last_picture

    def shown(self):
        """The canvas, once it shows what the renderer draws now; the camera may still be moving."""
        return self.tab.until(lambda canvas: difference(canvas, self.drawn()) < ALIKE)

    def open(self, tab, folder=None):
        """Open a tab of the panel, and in it a folder that is closed at first."""
        self.page.get_by_role("tab", name=tab).click()
        if folder is not None:
            self.page.get_by_text(folder, exact=True).click()

    def press(self, button):
        found = self.page.get_by_role("button", name=button)
        self.tab.wait_until_still(found)
        found.click()

    def says(self, text):
        """Wait until the page says something."""
        self.tab.wait_for_text(text)

    def cut(self, way, control, value):
        """Cut the hair in one of the ways of the panel."""
        self.open("Edit")
        self.page.get_by_role("combobox", name="Cut").click()
        self.page.get_by_role("option", name=way).click()
        self.tab.fill(control, value)
        self.press("Cut the hair")

    def undo(self, listed):
        """Take the last edit back, which the list describes so."""
        self.page.get_by_text("Undo", exact=True).click()
        self.tab.wait_for_text(listed, "detached")

    def pixel(self, point):
        """Where a place in the world lies in the window."""
        camera = self.served.page.camera_of(self.client).sized(max(WINDOW))
        pixels, _ = camera.project(point[None])
        x, y = pixels[0].tolist()
        return x, y

    def painted(self):
        """How many strands the page says grow in the painted region."""
        return int(re.search(r"the ([\d,]+) strands", self.page.get_by_text("painted region.").inner_text())[1])

    def download(self, button):
        """What a button saves."""
        with self.page.expect_download() as download:
            self.press(button)
        return download.value


def difference(a, b):
    """Mean difference of two pictures, in levels."""
    small = [cv2.resize(each.astype(np.float32), SMALL, interpolation=cv2.INTER_AREA) for each in (a, b)]
    return float(np.abs(small[0] - small[1]).mean())
