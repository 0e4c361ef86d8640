"""What a browser finds in a report: a page parsed, its pictures decoded."""

import base64
from html.parser import HTMLParser

import cv2
import numpy as np


class ReportPage(HTMLParser):
    """Tables by heading, and pictures by caption, of a page that `write_page` wrote."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.pictures: list[tuple[str, np.ndarray]] = []
        self.addresses: list[str] = []
        self._heading = ""
        self._inside: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.addresses += [values[name] or "" for name in ("src", "href") if name in values]
        if tag == "h2":
            self._heading = ""
        elif tag == "table":
            self.tables[self._heading] = []
        elif tag == "tr":
            self.tables[self._heading].append([])
        elif tag in ("td", "th"):
            self.tables[self._heading][-1].append("")
        elif tag == "img":
            self.pictures.append((values["alt"] or "", decoded_address(values["src"] or "")))
        self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._inside and self._inside.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        within = self._inside[-1] if self._inside else ""
        if within == "h2":
            self._heading += data
        elif within in ("td", "th", "a"):
            self.tables[self._heading][-1][-1] += data


def decoded_address(address: str) -> np.ndarray:
    """The picture, RGB, that a data address holds."""
    kind, _, encoded = address.partition(";base64,")
    assert kind.startswith("data:image/"), kind
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(encoded, validate=True), np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    return pixels[..., ::-1].copy()
