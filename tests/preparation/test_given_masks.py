"""Masks of the hair that the user gives: which file belongs to which photograph."""

from pathlib import Path

import numpy as np
import pytest
from test_video import write_video

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.masks.segmenter import GivenMasks
from neural_strands.preparation.photographs.folder import Photograph, write_picture
from neural_strands.preparation.photographs.video import import_video


def mask(path: Path, value: int) -> None:
    write_picture(path, np.full((4, 6), value, np.uint8))


def test_frames_of_a_video_have_masks_named_like_their_pictures(tmp_path: Path):
    write_video(tmp_path / "clip.avi", 9, {1, 4, 7})
    (tmp_path / "out").mkdir()
    frames = import_video(tmp_path / "clip.avi", tmp_path / "out", 3, 2048, lambda _: None)
    folder = tmp_path / "masks"
    folder.mkdir()
    given = GivenMasks(folder, frames, {})
    # Not a mask of every frame.
    write_picture(folder / "clip.png", np.zeros((96, 128), np.uint8))
    with pytest.raises(InputError, match=r"found none of clip\.avi frame 1; add frame_000001\.png"):
        given.digest()
    for value, frame in enumerate(frames):
        write_picture(folder / frame.name, np.full((96, 128), value, np.uint8))
    given.digest()
    assert [int(given.read(frame.name).max()) for frame in frames] == [0, 1, 2]


def test_photographs_have_masks_named_like_their_files(tmp_path: Path):
    shots = [Photograph("a.png", "a.jpg", 6, 4), Photograph("a-2.png", "a.webp", 6, 4)]
    mask(tmp_path / "a.jpg.png", 1)
    mask(tmp_path / "a.webp.png", 2)
    given = GivenMasks(tmp_path, shots, {})
    assert [int(given.read(shot.name).max()) for shot in shots] == [1, 2]
