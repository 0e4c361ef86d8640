"""What a user gives or measures for the head of a person."""

from dataclasses import dataclass, field
from pathlib import Path

from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.face.files import parse_marks
from neural_strands.preparation.head.fit import KnownSize
from neural_strands.preparation.head.template import load_template


@dataclass(frozen=True)
class HeadRequest:
    """How to find a person's head.

    Attributes:
        landmarks: landmarks set by hand; detected if None.
        template: a head mesh; the built-in one if None.
        scalp: the template's scalp; found if None.
        size: sizes that the user measured.
        detector: finds faces and people.
        bend: whether the template is deformed to fit the person, or keeps its shape.
    """

    landmarks: Path | None = None
    template: Path | None = None
    scalp: Path | None = None
    size: KnownSize = field(default_factory=KnownSize)
    detector: Detector = field(default_factory=Detector)
    bend: bool = True

    def check(self) -> None:
        """Check the files, and that the detector exists if it is needed, before anything is computed.

        Raises:
            InputError: an interpreter or a model is missing, or a file of landmarks or a template is malformed.
        """
        if self.landmarks is None or self.template is not None or self.detector.python is not None:
            self.detector.check()
        if self.landmarks is not None:
            parse_marks(self.landmarks)
        if self.template is not None:
            load_template(self.template, self.scalp)
