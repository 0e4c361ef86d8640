"""Colours that videos state: boxes that are put into real files by hand."""

from pathlib import Path

import numpy as np
import pytest
from coloured_video import with_colours, write_grey_video

from neural_strands.preparation.photographs.hdr import hdr_transfer
from neural_strands.preparation.photographs.video import import_video


def write_plain(path: Path) -> None:
    write_grey_video(path, (40, 90, 140), (128, 96))


def write_with_colours(path: Path, kind: bytes, transfer: int) -> None:
    write_plain(path)
    path.write_bytes(with_colours(path.read_bytes(), kind, transfer))


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
