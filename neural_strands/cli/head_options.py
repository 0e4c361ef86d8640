"""Options of commands that fit a head to a person."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class HeadOptions:
    """What a head is made from."""

    template: Path | None = None
    """Head to fit to the person: a mesh with a face, y up, +z forward, or FLAME's .pkl. Default: the mannequin."""
    scalp: Path | None = None
    """The template's scalp: a chart, a list of faces or a painted mask. Default: found from the shape."""
    landmarks: Path | None = None
    """Landmarks set by hand, instead of detecting the face: JSON, {photograph: {landmark: [x, y]}}, pixels."""
    detector: Path | None = None
    """Python that has the package mediapipe, if this one does not."""
    face_model: Path | None = None
    """MediaPipe's face_landmarker.task; not needed with mediapipe 0.10.21, which includes its models."""
    bend: bool = True
    """Deform the template to match the person's face and outline; otherwise it keeps its shape."""
