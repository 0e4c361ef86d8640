"""The head of a capture: all code that needs it finds its file here.

A head given in addition to a capture replaces the capture's own. Both are in the cameras' frame, in metres;
`scalp_faces.json` beside the mesh, if it exists, says where hair grows.
"""

from pathlib import Path

from neural_strands.capture.capture import Capture
from neural_strands.foundation.errors import InputError
from neural_strands.scalp.head import Head
from neural_strands.scalp.head_file import HeadFile, read_metric_head
from neural_strands.scalp.load import chart_head

HEAD_NAMES = ("head.obj", "head.ply", "head.stl", "head.glb")


def head_path(folder: Path, given: Path | None = None) -> Path | None:
    """Path of the head's mesh: the given file, or else the one in the capture's folder, or else None."""
    if given is not None:
        return given
    return next((folder / name for name in HEAD_NAMES if (folder / name).is_file()), None)


def read_head(capture: Capture, given: Path | None = None) -> HeadFile | None:
    """Read the given head, or else the capture's own, without charting its scalp; None if there is none.

    Raises:
        InputError: a file is missing or broken, or the head is obviously not in metres.
    """
    path = head_path(capture.folder, given)
    return None if path is None else read_metric_head(path)


def find_head(capture: Capture, given: Path | None = None) -> Head:
    """Read the head as a fit needs it: its scalp found if no file names it, and charted.

    Raises:
        InputError: as for `read_head`, or there is no head.
    """
    file = read_head(capture, given)
    if file is None:
        raise InputError(
            f"{capture.folder}: expected head.obj (the head in the cameras' frame, metres), found none; "
            "fit one with `neural-strands fit-head`, put one there, or name it with --head."
        )
    return chart_head(file)
