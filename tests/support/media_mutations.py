"""Damage inside photographs and videos, with lengths that fit: segments of JPEG, boxes of MP4 and HEIC."""

from collections.abc import Callable
from random import Random

Edit = Callable[[Random, bytes], bytes]
JPEG, BOXES = b"\xff\xd8", b"ftyp"
SCAN = 0xDA
"""Marker of a JPEG after which its compressed picture follows."""
OUTER = {b"moov": 0, b"trak": 0, b"mdia": 0, b"minf": 0, b"stbl": 0, b"iprp": 0, b"ipco": 0, b"meta": 4, b"stsd": 8}
"""Boxes that hold boxes, and how many bytes come before these."""


def damaged_jpeg(random: Random, content: bytes, edit: Edit) -> bytes:
    """A JPEG with one damaged segment; all that follows the last marker counts as one."""
    segments, at = [], len(JPEG)
    while at + 4 <= len(content) and content[at] == 0xFF and content[at + 1] != SCAN:
        length = int.from_bytes(content[at + 2 : at + 4], "big")
        segments.append((content[at : at + 2], content[at + 4 : at + 2 + length]))
        at += 2 + length
    place, rest = random.randrange(len(segments) + 1), content[at:]
    if place == len(segments):
        rest = edit(random, rest)
    else:
        segments[place] = (segments[place][0], edit(random, segments[place][1])[: 2**16 - 3])
    return JPEG + b"".join(kind + (2 + len(data)).to_bytes(2, "big") + data for kind, data in segments) + rest


def damaged_boxes(random: Random, content: bytes, edit: Edit) -> bytes:
    """A file of boxes in which one is damaged, at a random depth; it is edited as a whole if it has none."""
    boxes, at = [], 0
    while at + 8 <= len(content):
        size = int.from_bytes(content[at : at + 4], "big")
        if not 8 <= size <= len(content) - at:
            break
        boxes.append((content[at + 4 : at + 8], content[at + 8 : at + size]))
        at += size
    if not boxes:
        return edit(random, content)
    place = random.randrange(len(boxes))
    kind, inside = boxes[place]
    start = OUTER.get(kind)
    if start is None or random.random() < 0.1:
        inside = edit(random, inside)
    else:
        inside = inside[:start] + damaged_boxes(random, inside[start:], edit)
    boxes[place] = (kind, inside)
    return b"".join((8 + len(data)).to_bytes(4, "big") + kind + data for kind, data in boxes) + content[at:]
