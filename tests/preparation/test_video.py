"""Frames of a video: the sharpest of each stretch, in order."""

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


def write_video(path: Path, count: int, sharp: set[int]) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (128, 96))
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


def test_blur_is_less_sharp():
    assert frame_sharpness(frame(1, False)) > 2 * frame_sharpness(frame(1, True))


def test_a_video_that_does_not_decode_is_one_sentence(tmp_path: Path):
    path = tmp_path / "a.mp4"
    path.write_bytes(b"no video at all" * 100)
    assert is_video(path)
    (tmp_path / "out").mkdir()
    with pytest.raises(InputError, match="at least 3 frames that decode, found 0"):
        import_video(path, tmp_path / "out", 10, 2048, print)
