"""Imports photographs from a video: the sharpest frame of each stretch."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from neural_strands.capture.images import reduced
from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.preparation.photographs.folder import FEWEST, Photograph, write_list, write_picture
from neural_strands.preparation.photographs.hdr import hdr_transfer

SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")
"""Suffixes of videos, in upper or lower case."""
QUIET = "-8"
"""FFmpeg's level of messages at which it reports nothing."""
MISCOUNT = 0.05
"""Largest relative difference between the frames that a video says it has and those that it has."""
JUDGED_SIDE = 320
"""Longer side at which the sharpness of frames is measured, pixels: noise averages out, motion blur remains."""


def is_video(path: Path) -> bool:
    """Whether a path has the suffix of a video."""
    return path.suffix.lower() in SUFFIXES


def import_video(path: Path, out: Path, frames: int, longest_side: int, say: Callable[[str], None]) -> list[Photograph]:
    """Divide a video into `frames` equal stretches and write the sharpest frame of each as an upright PNG.

    Args:
        path: the video.
        out: an existing folder.
        frames: number of frames to take; fewer if the video has fewer.
        longest_side: largest side afterwards, pixels.
        say: receives messages for the user.

    Raises:
        InputError: the video does not decode, or has too few frames.
    """
    # Otherwise its decoder writes lines of its own to the terminal. A value that the user set is kept.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", QUIET)
    with _silent_opencv():
        expected = _claimed_frames(path)
        photographs, number = _sharpest(path, out, frames, longest_side, expected)
        if abs(number - expected) > MISCOUNT * expected:
            # Recordings of browsers and screens do not say how long they are, or count what is no frame.
            for photograph in photographs:
                (out / photograph.name).unlink()
            photographs, number = _sharpest(path, out, frames, longest_side, number)
    if len(photographs) < FEWEST:
        raise InputError(
            f"{path}: expected a video of at least {FEWEST} frames that decode, found {number}; convert it to MP4 "
            "(H.264), or give photographs."
        )
    write_list(out, photographs)
    say(f"{len(photographs)} of {number} frames taken, the sharpest of each interval.")
    transfer = hdr_transfer(path)
    if transfer is not None:
        say(
            f"{path.name}: expected a video of standard dynamic range, found HDR ({transfer}), whose frames come out "
            "flat and pale; convert it to SDR, or record with HDR switched off, for true colours."
        )
    return photographs


@contextmanager
def _silent_opencv() -> Iterator[None]:
    """Keep OpenCV from writing to the terminal that it has no decoder for a video."""
    log = cv2.utils.logging
    level = log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)


def _claimed_frames(path: Path) -> int:
    """Number of frames that a video says it has; 0 if it says none."""
    capture = cv2.VideoCapture(str(path))
    try:
        return max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0) if capture.isOpened() else 0
    finally:
        capture.release()


def _sharpest(path: Path, out: Path, frames: int, longest_side: int, expected: int) -> tuple[list[Photograph], int]:
    """Write the sharpest frame of each of `frames` stretches of a video that should have `expected` frames.

    Returns:
        The frames that were written (none if no frame was expected), and the number of all frames that decode.
    """
    photographs: list[Photograph] = []
    best: tuple[float, int, np.ndarray] | None = None  # sharpness, number, frame
    stretch, total = 0, 0
    for number, frame in enumerate(track(_frames_of(path), "reading the video", total=expected or None)):
        total += 1
        if not expected:
            continue
        # Only the best frame of the present stretch is in memory.
        present = min(number * frames // expected, frames - 1)
        if best is not None and present > stretch:
            photographs.append(_write(best, path, out, longest_side))
            best = None
        stretch = present
        sharp = frame_sharpness(frame)
        if best is None or sharp > best[0]:
            best = (sharp, number, frame)
    if best is not None:
        photographs.append(_write(best, path, out, longest_side))
    return photographs, total


def _frames_of(path: Path) -> Iterator[np.ndarray]:
    """The frames of a video (height, width, 3; BGR), upright, up to the first that does not decode."""
    capture = cv2.VideoCapture(str(path))
    try:
        there, frame = capture.read()
        while there:
            yield frame
            there, frame = capture.read()
    finally:
        capture.release()


def _write(chosen: tuple[float, int, np.ndarray], video: Path, out: Path, longest_side: int) -> Photograph:
    """Write the frame (height, width, 3; BGR) that was chosen, with its sharpness and number, and describe it."""
    _, number, whole = chosen
    frame = reduced(whole, longest_side)
    name = f"frame_{number:06d}.png"
    write_picture(out / name, np.ascontiguousarray(frame[:, :, ::-1]))
    height, width = frame.shape[:2]
    return Photograph(name, f"{video.name} frame {number}", width, height, 0.0, video.name, width / whole.shape[1])


def frame_sharpness(frame: np.ndarray) -> float:
    """Sharpness of a picture (height, width, 3): the variance of its Laplacian after it is reduced to `JUDGED_SIDE`."""
    grey = cv2.cvtColor(reduced(frame, JUDGED_SIDE), cv2.COLOR_BGR2GRAY)
    return float(cv2.Laplacian(grey, cv2.CV_32F).var())
