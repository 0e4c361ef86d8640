"""What a user asks `prepare` for."""

from dataclasses import dataclass, field
from pathlib import Path

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.files import is_taken
from neural_strands.preparation.head.request import HeadRequest
from neural_strands.preparation.masks.segmenter import Segmenter
from neural_strands.preparation.source import Source

STAGES = "preparation"
"""Name of the folder with the stages, in the capture."""


@dataclass(frozen=True)
class PrepareRequest:
    """Inputs and settings for making a capture.

    Attributes:
        photographs: a folder of pictures, a video, or a model of calibrated photographs (`source.py`).
        out: folder of the capture.
        cameras: file or folder with calibrated cameras; estimated from the photographs if None.
        masks: a folder with masks of the hair, named like the photographs; computed if None.
        segmenter: a command or a function that makes masks of the hair (`masks/segmenter.py`). With a function, they
            are made in every run, because it may have changed.
        longest_side: largest side of a picture, pixels.
        frames: number of frames to take from a video.
        subject_turns: whether the person turns before a camera that stands still, instead of the camera moving.
        keep_exposure: whether to leave the photographs' exposure and white balance as they are.
        head: how to find the head.
    """

    photographs: Path
    out: Path
    cameras: Path | None = None
    masks: Path | None = None
    segmenter: str | Segmenter | None = None
    longest_side: int = 2048
    frames: int = 80
    subject_turns: bool = False
    keep_exposure: bool = False
    head: HeadRequest = field(default_factory=HeadRequest)


def check_out(request: PrepareRequest, source: Source) -> None:
    """Check that no file of the user's would be lost: pictures and masks in the capture are replaced.

    Raises:
        InputError: the folder contains something other than a preparation, or the photographs or masks themselves.
    """
    out = request.out
    begun = (out / STAGES).is_dir()
    if not begun and is_taken(out):
        raise InputError(
            f"{out}: expected a new or empty folder, or one that prepare began, found another; name a new one."
        )
    folders = sorted({file.parent for file in source.files})
    for path in (request.photographs, request.masks, *folders):
        if path is not None and path.resolve().is_relative_to(out.resolve()):
            raise InputError(
                f"{path}: expected a folder outside {out}, which is written to; name another for the capture."
            )
