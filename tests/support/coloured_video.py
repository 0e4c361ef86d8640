"""Small videos, and the box by which a video states its colours, put into a real file by hand."""

import struct
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np


def write_grey_video(path: Path, levels: Sequence[int], size: tuple[int, int]) -> None:
    """Frames of MPEG-4, each of one grey; the size is width and height."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, size)
    for level in levels:
        writer.write(np.full((size[1], size[0], 3), level, np.uint8))
    writer.release()


def with_colours(plain: bytes, kind: bytes, transfer: int) -> bytes:
    """The file with a box of colours at the end of the video's description; all boxes around it grow by as much."""
    content = bytearray(plain)
    colours = kind + struct.pack(">HHH", 9, transfer, 9) + (b"\0" if kind == b"nclx" else b"")
    box = struct.pack(">I", 8 + len(colours)) + b"colr" + colours
    entry = content.index(b"mp4v", content.index(b"stsd")) - 4
    end = entry + struct.unpack_from(">I", content, entry)[0]
    around = [content.index(name) - 4 for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd")]
    for at in (*around, entry):
        struct.pack_into(">I", content, at, struct.unpack_from(">I", content, at)[0] + len(box))
    content[end:end] = box
    return bytes(content)
