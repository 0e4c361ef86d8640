"""The head of a capture: the one place that says which file it is.

A head that is named beside a capture replaces the capture's own. Either lies in the cameras' frame, in metres, and
`scalp_faces.json` beside it says where hair grows, where there is one.
"""

from pathlib import Path

from neural_strands.capture.capture import Capture
from neural_strands.foundation.errors import InputError
from neural_strands.scalp.head import Head
from neural_strands.scalp.head_file import HeadFile, read_metric_head
from neural_strands.scalp.load import chart_head

HEAD_NAMES = ("head.obj", "head.ply", "head.stl", "head.glb")


def head_path(folder: Path, given: Path | None = None) -> Path | None:
    """The head's mesh: the file that is given, or else the one in a capture's folder, or else None."""
    if given is not None:
        return given
    return next((folder / name for name in HEAD_NAMES if (folder / name).is_file()), None)


def read_head(capture: Capture, given: Path | None = None) -> HeadFile | None:
    """Read the head that is given, or else the capture's own, without charting its scalp; None where there is none.

    Raises:
        InputError: a file is missing or broken, or the head is obviously not in metres.
    """
    path = head_path(capture.folder, given)
    return None if path is None else read_metric_head(path)


def find_head(capture: Capture, given: Path | None = None) -> Head:
    """The same head as a fit needs it, its scalp found where no file names it, and charted.

    Raises:
        InputError: as `read_head`, or there is no head.
    """
    file = read_head(capture, given)
    if file is None:
        raise InputError(
            f"{capture.folder}: expected head.obj (the head in the cameras' frame, metres), found none; "
            "fit one with `neural-strands fit-head`, put one there, or name it with --head."
        )
    return chart_head(file)
