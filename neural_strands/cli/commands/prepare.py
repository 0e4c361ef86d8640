"""`neural-strands prepare`: a folder of photographs becomes a capture."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from neural_strands.cli.head_options import HeadOptions
from neural_strands.cli.streams import print_json, say
from neural_strands.preparation.bounds import FrameCount, LongestSide, MetresPerUnit, PupilDistance


@dataclass(frozen=True)
class Prepare(HeadOptions):
    """Make a capture from photographs of one person: cameras, scale, head and hair masks.

    Take 24 or more photographs from all around and above, in small steps and even light; hair and head must keep
    still. `neural-strands check` and `fit` read OUT. Every stage is kept in OUT/preparation: a stopped run continues
    where it left off, and a stage runs again only if its inputs changed.
    """

    photographs: Annotated[Path, tyro.conf.Positional]
    """Folder of photographs (JPEG, PNG, TIFF, WebP, HEIC), of one size or several; a video; or a model of photographs
    with known cameras: a folder with a COLMAP model and its images, transforms.json, or Metashape's .xml or
    RealityCapture's .csv in the folder of the photographs."""
    out: Annotated[Path, tyro.conf.Positional]
    """Folder for the capture."""
    cameras: Path | None = None
    """Known cameras of the photographs in PHOTOGRAPHS, instead of estimating them: a folder with a COLMAP model,
    transforms.json, Metashape's .xml or RealityCapture's .csv."""
    masks: Path | None = None
    """Hair masks, instead of segmenting the hair: a folder of PNG files named like the photographs, white where there
    is hair."""
    segmenter: str | None = None
    """Program that makes hair masks, with {image} and {mask} for the paths of a picture and its mask."""
    person_model: Path | None = None
    """One of MediaPipe's selfie segmenters (.tflite). Default: like `--face-model`."""
    scale: MetresPerUnit | None = None
    """Metres in one unit of the cameras, if known."""
    pupil_distance: PupilDistance | None = None
    """Distance between the person's pupils, millimetres, as on a prescription for glasses: removes most of the scale's
    error, which is otherwise about 3%."""
    longest_side: LongestSide = 2048
    """Larger photographs are reduced to this many pixels along the longer side."""
    frames: FrameCount = 80
    """Frames to take from a video: the sharpest one of each of this many intervals."""
    subject_turns: bool = False
    """The person turned before a camera that stood still: the background is ignored when cameras are estimated."""
    keep_exposure: bool = False
    """Leave exposure and white balance of the photographs as they are, instead of making them alike."""
    json: bool = False
    """Print the figures as one JSON object."""

    def run(self) -> None:
        """Prepare, saying what happens on standard error."""
        from neural_strands.preparation.prepare import prepare
        from neural_strands.preparation.request import PrepareRequest

        request = PrepareRequest(
            self.photographs,
            self.out,
            self.cameras,
            self.masks,
            self.segmenter,
            self.longest_side,
            self.frames,
            self.subject_turns,
            self.keep_exposure,
            self.head_request(self.scale, self.pupil_distance, self.person_model),
        )
        figures = prepare(request, say)
        if self.json:
            print_json(figures)
            return
        sys.stdout.write(f"{self.out}: {figures['cameras']} views; next: neural-strands check {self.out}\n")
