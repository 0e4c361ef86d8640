"""Writes videos as MPEG-4."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import atomic_file

Frame = UInt8[np.ndarray, "height width 3"]


@contextmanager
def video_writer(path: Path, size: tuple[int, int], fps: float) -> Iterator[Callable[[Frame], None]]:
    """Yield a function that appends an RGB frame to a video, which is written atomically.

    Args:
        path: the file, .mp4.
        size: width and height of the frames, pixels. The codec needs even sides, so one column or row may be dropped.
        fps: frames per second.

    Raises:
        InputError: OpenCV has no encoder, or the file cannot be written.
    """
    even = (max(size[0] // 2 * 2, 2), max(size[1] // 2 * 2, 2))
    with atomic_file(path) as temporary:
        # OpenCV does not tell a folder that cannot be written to from a missing encoder.
        temporary.touch()
        video = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*"mp4v"), fps, even)
        if not video.isOpened():
            raise InputError(f"{path}: expected an MPEG-4 encoder in OpenCV, found none; write images instead.")

        def write(frame: Frame) -> None:
            sized = frame if frame.shape[1::-1] == even else cv2.resize(frame, even)
            video.write(cv2.cvtColor(sized, cv2.COLOR_RGB2BGR))

        try:
            yield write
        finally:
            video.release()
