"""Tells whether a video has a high dynamic range, from the colours that its MP4 or MOV file states (`colr`).

Phones record such videos by default. Their decoded frames hold HLG or PQ values, which look flat and pale as sRGB.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

HDR_TRANSFERS = {16: "PQ", 18: "HLG"}
"""Transfer characteristics of high dynamic range (ITU-T H.273, table 3)."""
BOXES_TO_ENTRIES = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd")
"""Boxes around the descriptions of a track's samples (ISO 14496-12)."""
BEFORE_ENTRIES, BEFORE_EXTENSIONS = 8, 78
"""Bytes of `stsd` before its entries, and of a video's entry before its boxes."""
COLOUR_KINDS = (b"nclx", b"nclc")


def hdr_transfer(path: Path) -> str | None:
    """The transfer curve of an HDR video, "HLG" or "PQ"; None if the file states another or none.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        places = [(0, size)]
        for kind in BOXES_TO_ENTRIES:
            places = [place for outer in places for found, place in _boxes(file, *outer) if found == kind]
        entries = [entry for start, end in places for _, entry in _boxes(file, start + BEFORE_ENTRIES, end)]
        for start, end in entries:
            for kind, (inside, _) in _boxes(file, start + BEFORE_EXTENSIONS, end):
                file.seek(inside)
                colours = file.read(8) if kind == b"colr" else b""
                if len(colours) == 8 and colours[:4] in COLOUR_KINDS:
                    transfer = HDR_TRANSFERS.get(int.from_bytes(colours[6:8], "big"))
                    if transfer is not None:
                        return transfer
    return None


def _boxes(file: BinaryIO, start: int, end: int) -> Iterator[tuple[bytes, tuple[int, int]]]:
    """Kind and place of the content (start, end) of the boxes between two positions; stops at the first damaged one."""
    while start + 8 <= end:
        file.seek(start)
        header = file.read(16)
        size, kind, inside = int.from_bytes(header[:4], "big"), header[4:8], start + 8
        if size == 1:
            size, inside = int.from_bytes(header[8:16], "big"), start + 16
        if size == 0:
            size = end - start
        if size < inside - start or start + size > end:
            return
        yield kind, (inside, start + size)
        start += size
