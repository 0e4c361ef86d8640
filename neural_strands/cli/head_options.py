"""Options of commands that fit a head to a person."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from neural_strands.preparation.head.request import HeadRequest


@dataclass(frozen=True, kw_only=True)
class HeadOptions:
    """What a head is made from."""

    template: Path | None = None
    """Head to fit to the person: a mesh with a face, y up, +z forward, or FLAME's .pkl. Default: the built-in head."""
    scalp: Path | None = None
    """The template's scalp: a chart, a list of faces or a painted mask. Default: found from the shape."""
    landmarks: Path | None = None
    """Landmarks set by hand, instead of detecting the face: JSON, {photograph: {landmark: [x, y]}}, pixels."""
    detector: Path | None = None
    """Python that has the package mediapipe, if this one does not."""
    face_model: Path | None = None
    """MediaPipe's face_landmarker.task. Default: the one inside mediapipe 0.10.21; for later versions, the published
    one, which is fetched once."""
    bend: bool = True
    """Deform the template to match the person's face and outline. With --no-bend, it keeps its shape."""

    def head_request(
        self, scale: float | None, pupil_distance: float | None = None, person_model: Path | None = None
    ) -> "HeadRequest":
        """Combine the options with what is known of the size.

        Args:
            scale: metres in one unit of the cameras, if known.
            pupil_distance: millimetres between the pupils, if known.
            person_model: finds the person's outline; the detector's own if None.
        """
        from neural_strands.preparation.face.detector import Detector
        from neural_strands.preparation.head.fit import KnownSize
        from neural_strands.preparation.head.request import HeadRequest

        size = KnownSize(scale, None if pupil_distance is None else 0.001 * pupil_distance)
        detector = Detector(self.detector, self.face_model, person_model)
        return HeadRequest(self.landmarks, self.template, self.scalp, size, detector, self.bend)
