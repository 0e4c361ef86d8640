"""Colours that videos state: boxes that are put into real files by hand."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from neural_strands.preparation.photographs.hdr import hdr_transfer
from neural_strands.preparation.photographs.video import import_video


def write_plain(path: Path) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (128, 96))
    for level in (40, 90, 140):
        writer.write(np.full((96, 128, 3), level, np.uint8))
    writer.release()


def write_with_colours(path: Path, kind: bytes, transfer: int) -> None:
    """A video whose description ends with a box of colours; all boxes around it grow by as much."""
    write_plain(path)
    content = bytearray(path.read_bytes())
    colours = kind + struct.pack(">HHH", 9, transfer, 9) + (b"\0" if kind == b"nclx" else b"")
    box = struct.pack(">I", 8 + len(colours)) + b"colr" + colours
    entry = content.index(b"mp4v", content.index(b"stsd")) - 4
    end = entry + struct.unpack_from(">I", content, entry)[0]
    around = [content.index(name) - 4 for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd")]
    for at in (*around, entry):
        struct.pack_into(">I", content, at, struct.unpack_from(">I", content, at)[0] + len(box))
    content[end:end] = box
    path.write_bytes(content)


@pytest.mark.parametrize("kind", [b"nclx", b"nclc"])
@pytest.mark.parametrize(("transfer", "expected"), [(18, "HLG"), (16, "PQ"), (1, None), (13, None)])
def test_the_transfer_is_the_one_that_the_file_states(tmp_path: Path, kind: bytes, transfer: int, expected: str | None):
    path = tmp_path / "a.mp4"
    write_with_colours(path, kind, transfer)
    assert hdr_transfer(path) == expected


def test_hdr_is_said_and_the_frames_are_taken(tmp_path: Path):
    said: list[str] = []
    for name, transfer in (("hdr", 18), ("sdr", 1)):
        write_with_colours(tmp_path / f"{name}.mp4", b"nclx", transfer)
        (tmp_path / name).mkdir()
        assert len(import_video(tmp_path / f"{name}.mp4", tmp_path / name, 3, 2048, said.append)) == 3
    assert [message for message in said if "HDR" in message] == [
        "hdr.mp4: expected a video of standard dynamic range, found HDR (HLG), whose frames come out flat and pale; "
        "convert it to SDR, or record with HDR switched off, for true colours."
    ]


def test_other_and_damaged_files_state_nothing(tmp_path: Path):
    path = tmp_path / "a.mp4"
    write_plain(path)
    assert hdr_transfer(path) is None
    write_with_colours(path, b"nclx", 18)
    whole = path.read_bytes()
    for size in range(0, len(whole), 7):
        path.write_bytes(whole[:size])
        assert hdr_transfer(path) is None
    random = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[int(random.integers(len(whole)))] = int(random.integers(256))
        path.write_bytes(damaged)
        assert hdr_transfer(path) in (None, "HLG", "PQ")
