"""Frames of a video: the sharpest of each stretch, in order."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.photographs.folder import read_list, read_picture
from neural_strands.preparation.photographs.video import frame_sharpness, import_video, is_video


def frame(number: int, blurred: bool) -> np.ndarray:
    picture = np.random.default_rng(number).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    picture = cv2.resize(picture[::8, ::8], (128, 96), interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(picture, (0, 0), 4) if blurred else picture


def write_video(path: Path, count: int, sharp: set[int], codec: str = "MJPG") -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), 25, (128, 96))
    for number in range(count):
        writer.write(frame(number, number not in sharp))
    writer.release()


def test_the_sharpest_frame_of_each_stretch_is_taken(tmp_path: Path):
    write_video(tmp_path / "a.avi", 20, {3, 7, 11, 18})
    (tmp_path / "out").mkdir()
    found = import_video(tmp_path / "a.avi", tmp_path / "out", 4, 2048, lambda _: None)
    assert [photograph.name for photograph in found] == [f"frame_{k:06d}.png" for k in (3, 7, 11, 18)]
    assert read_list(tmp_path / "out") == found
    # The colours are in the right order; compression changes them slightly.
    difference = read_picture(tmp_path / "out" / "frame_000007.png")[..., ::-1].astype(int) - frame(7, False)
    assert np.abs(difference).mean() < 12


def test_large_frames_shrink(tmp_path: Path):
    write_video(tmp_path / "a.avi", 6, set())
    (tmp_path / "out").mkdir()
    found = import_video(tmp_path / "a.avi", tmp_path / "out", 3, 64, lambda _: None)
    assert {(photograph.width, photograph.height) for photograph in found} == {(64, 48)}


def test_a_video_held_on_its_side_is_turned(tmp_path: Path):
    write_video(tmp_path / "a.mp4", 6, {1, 3, 5}, "mp4v")
    content = bytearray((tmp_path / "a.mp4").read_bytes())
    # The matrix of the track's header (ISO 14496-12, 8.3.2): a quarter turn clockwise, moved back into the picture.
    at = content.index(b"tkhd") + 44
    assert struct.unpack(">9i", content[at : at + 36]) == (1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
    content[at : at + 36] = struct.pack(">9i", 0, 1 << 16, 0, -1 << 16, 0, 0, 96 << 16, 0, 1 << 30)
    (tmp_path / "b.mp4").write_bytes(content)
    pictures = []
    for name in "ab":
        (tmp_path / name).mkdir()
        found = import_video(tmp_path / f"{name}.mp4", tmp_path / name, 3, 2048, lambda _: None)
        assert [photograph.name for photograph in found] == [f"frame_{k:06d}.png" for k in (1, 3, 5)]
        pictures.append(read_picture(tmp_path / name / "frame_000003.png"))
    np.testing.assert_array_equal(pictures[1], np.rot90(pictures[0], -1))


@pytest.mark.parametrize("claim", [None, 0.02, 40.0])
def test_a_video_need_not_know_its_length(tmp_path: Path, claim: float | None):
    write_video(tmp_path / "a.mkv", 20, {3, 7, 11, 18}, "mp4v")
    content = bytearray((tmp_path / "a.mkv").read_bytes())
    # Matroska's element Duration: its name, its size of 8 bytes, and milliseconds as a floating-point number.
    at = content.index(b"\x44\x89\x88")
    assert struct.unpack(">d", content[at + 3 : at + 11])[0] == pytest.approx(800)
    # Without a length, the element is one to be skipped (Void).
    content[at : at + 11] = (
        b"\xec\x89" + bytes(9) if claim is None else b"\x44\x89\x88" + struct.pack(">d", 1000 * claim)
    )
    (tmp_path / "a.mkv").write_bytes(content)
    (tmp_path / "out").mkdir()
    said: list[str] = []
    found = import_video(tmp_path / "a.mkv", tmp_path / "out", 4, 2048, said.append)
    assert [photograph.name for photograph in found] == [f"frame_{k:06d}.png" for k in (3, 7, 11, 18)]
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {photograph.name for photograph in found}
    assert said == ["4 of 20 frames taken, the sharpest of each interval."]


def test_blur_is_less_sharp():
    assert frame_sharpness(frame(1, False)) > 2 * frame_sharpness(frame(1, True))


def test_a_video_that_does_not_decode_is_one_sentence(tmp_path: Path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"no video at all" * 100)
    assert is_video(path)
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="at least 3 frames that decode, found 0"):
        import_video(path, tmp_path / "out", 10, 2048, print)


def test_a_video_without_a_decoder_is_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    write_video(tmp_path / "a.mp4", 6, set(), "mp4v")
    content = bytearray((tmp_path / "a.mp4").read_bytes())
    # The name of the samples' format, and the type of the stream in its descriptor (ISO 14496-14, 3.1.2).
    entry = content.index(b"mp4v", content.index(b"stsd"))
    content[entry : entry + 4] = b"none"
    content[content.index(b"\x20\x11", content.index(b"esds"))] = 0
    (tmp_path / "a.mp4").write_bytes(content)
    (tmp_path / "out").mkdir()
    capfd.readouterr()
    level = cv2.utils.logging.getLogLevel()
    with pytest.raises(InputError, match="expected a video of at least 3 frames that decode, found 0"):
        import_video(tmp_path / "a.mp4", tmp_path / "out", 3, 2048, lambda _: None)
    assert "ERROR" not in "".join(capfd.readouterr())
    assert cv2.utils.logging.getLogLevel() == level
