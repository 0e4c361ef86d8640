"""`neural-strands prepare`: a folder of photographs becomes a capture."""

import json as json_module
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.head_options import HeadOptions
from neural_strands.cli.streams import say
from neural_strands.foundation.errors import InputError


@dataclass(frozen=True)
class Prepare(HeadOptions):
    """Make a capture of photographs of one person: cameras, scale, head and hair masks.

    Take 24 or more, from all around and above, each a small step from the last, in even light, hair and head still.
    OUT is what `neural-strands check` and `fit` take. Every stage is kept in OUT/preparation: a run that was stopped
    goes on where it was, and a stage is done again only if what it is made from changed.
    """

    photographs: Annotated[Path, tyro.conf.Positional]
    """Folder of photographs (JPEG, PNG, TIFF, WebP, HEIC), of one size or several; or a video."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    cameras: Path | None = None
    """Known cameras, instead of finding them: a folder with a COLMAP model, or transforms.json."""
    masks: Path | None = None
    """Masks of the hair, instead of finding it: a folder of PNG files named as the photographs, white where hair is."""
    segmenter: str | None = None
    """Program that makes masks of the hair, with {image} and {mask} for the paths of a picture and of its mask."""
    person_model: Path | None = None
    """A selfie segmenter of MediaPipe's (.tflite); not needed with mediapipe 0.10.21."""
    scale: float | None = None
    """Metres in one unit of the cameras, if known."""
    pupil_distance: float | None = None
    """Millimetres between the person's pupils, as on a prescription for glasses: makes the scale exact."""
    longest_side: int = 2048
    """Larger photographs are made this many pixels long."""
    frames: int = 80
    """Frames to take of a video: of so many stretches the sharpest each."""
    json: bool = False
    """Print the figures as one JSON object."""

    def run(self) -> None:
        """Prepare, saying what happens on standard error."""
        from neural_strands.preparation.face.detector import Detector
        from neural_strands.preparation.head.fit import KnownSize
        from neural_strands.preparation.prepare import PrepareRequest, prepare

        for name, value, least, most in (
            ("scale", self.scale, 1e-6, 1e6),
            ("pupil-distance", self.pupil_distance, 40.0, 85.0),
            ("longest-side", self.longest_side, 256, 16384),
            ("frames", self.frames, 3, 2000),
        ):
            if value is not None and not least <= value <= most:
                raise InputError(f"--{name}: expected {least:g} to {most:g}, found {value:g}.")
        distance = None if self.pupil_distance is None else 0.001 * self.pupil_distance
        request = PrepareRequest(
            self.photographs,
            self.out,
            self.cameras,
            self.landmarks,
            self.template,
            self.scalp,
            self.masks,
            self.segmenter,
            KnownSize(self.scale, distance),
            Detector(self.detector, self.face_model, self.person_model),
            self.longest_side,
            self.frames,
            self.bend,
        )
        figures = prepare(request, say)
        if self.json:
            sys.stdout.write(json_module.dumps(figures) + "\n")
            return
        sys.stdout.write(f"{self.out}: {figures['cameras']} views; next: neural-strands check {self.out}\n")
