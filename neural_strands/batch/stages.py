"""The stages of a subject; they call the same functions as the commands of the same names."""

import math
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import torch

from neural_strands.batch.records import FIGURES, THUMBNAIL
from neural_strands.batch.storage import INPUTS, fetched
from neural_strands.batch.subjects import Stage, Subject
from neural_strands.capture.capture import Capture
from neural_strands.capture.head import find_head
from neural_strands.capture.hold_out import training_views
from neural_strands.capture.images import read_pixels
from neural_strands.capture.mask_agreement import with_judged_masks
from neural_strands.fitting.fit_data import check_views
from neural_strands.fitting.stereo import find_segments, segments_source
from neural_strands.foundation.files import write_json
from neural_strands.foundation.progress import Feedback
from neural_strands.lmvs.files import save_segments
from neural_strands.pictures.encoding import write_png
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.head.fit import KnownSize
from neural_strands.preparation.head.request import HeadRequest
from neural_strands.preparation.prepare import prepare
from neural_strands.preparation.request import STAGES as PREPARATION
from neural_strands.preparation.request import PrepareRequest
from neural_strands.runs.evaluate import evaluate_run, open_run
from neural_strands.runs.report import write_report
from neural_strands.runs.run_fit import FitRequest, run_fit

CAPTURE, SEGMENTS, STEREO, RUN, EVALUATION = "capture", "segments.npz", "lmvs", "run", "figures.json"
"""Names in the folder of a subject."""
THUMBNAIL_WIDTH = 480
"""Width of the thumbnail of photograph, strands and rendering, pixels."""


@dataclass(frozen=True)
class StageWork:
    """The inputs of a stage.

    Attributes:
        subject: the subject.
        folder: local copy of the subject's folder.
        device: where to compute.
        feedback: receives messages and progress.
    """

    subject: Subject
    folder: Path
    device: torch.device
    feedback: Feedback

    def input(self, place: str, name: str) -> Path:
        """Local path of a file or folder of the user's, which is fetched if it is remote.

        Raises:
            InputError: it cannot be fetched.
        """
        return fetched(place, self.folder / INPUTS / name)

    def optional(self, place: str | None) -> Path | None:
        """Like `input`, for a place that may be None."""
        return None if place is None else self.input(place, place.rstrip("/").rpartition("/")[2])

    def capture(self) -> Path:
        """Folder of the capture: the user's own, or the result of `prepare`."""
        subject = self.subject
        return self.input(subject.source, CAPTURE) if subject.prepared else self.folder / CAPTURE

    def segments(self) -> Path:
        """File of line segments: the user's own, or the result of `lmvs`."""
        given = self.optional(self.subject.segments)
        return self.folder / SEGMENTS if given is None else given


def prepare_subject(work: StageWork) -> dict[str, float]:
    """Make a capture from photographs."""
    options = work.subject.prepare
    distance = None if options.pupil_distance is None else 0.001 * options.pupil_distance
    head = HeadRequest(
        work.optional(options.landmarks),
        work.optional(options.template),
        work.optional(options.scalp),
        KnownSize(options.scale, distance),
        Detector(None if options.detector is None else Path(options.detector)),
        options.bend,
    )
    request = PrepareRequest(
        work.input(work.subject.source, "photographs"),
        work.folder / CAPTURE,
        work.optional(options.cameras),
        work.optional(options.masks),
        longest_side=options.longest_side,
        frames=options.frames,
        head=head,
    )
    return {"views": float(prepare(request, work.feedback.say)["cameras"])}


def find_subject_segments(work: StageWork) -> dict[str, float]:
    """Reconstruct line segments from the training views."""
    config = work.subject.config
    capture = Capture.load(work.capture())
    seen = capture.subset(training_views(len(capture), config.hold_out_every))
    check_views(seen)
    head = find_head(capture)
    if config.correct_masks:
        seen = with_judged_masks(seen, range(len(seen)), head.mesh, work.feedback.say)
    stereo = work.folder / STEREO
    segments = find_segments(seen, head, config, stereo, work.feedback.track, work.device)
    save_segments(work.folder / SEGMENTS, segments, segments_source(seen, config))
    # Finished views are only useful to a stopped run, and larger than all results together.
    shutil.rmtree(stereo, ignore_errors=True)
    return {"points": float(len(segments))}


def fit_subject(work: StageWork) -> dict[str, float]:
    """Fit the capture, from the last checkpoint if there is one."""
    request = FitRequest(work.capture(), work.folder / RUN, segments=work.segments(), resume=True)
    state = run_fit(request, work.subject.config, work.device, work.feedback)
    return {"strands": float(len(state.drawn)), "steps": float(state.step)}


def evaluate_subject(work: StageWork) -> dict[str, float]:
    """Write the report of the fit, and its figures to `figures.json`."""
    work.capture()
    run = open_run(work.folder / RUN, work.device)
    result = evaluate_run(run, work.device)
    write_report(run, result)
    _write_thumbnail(run.folder.report / "summary.png", work.folder / THUMBNAIL)
    figures = result.as_dict()
    write_json(work.folder / EVALUATION, figures)
    return {path: value for path in FIGURES if (value := _figure(figures, path)) is not None}


WORK: Mapping[Stage, Callable[[StageWork], dict[str, float]]] = {
    "prepare": prepare_subject,
    "lmvs": find_subject_segments,
    "fit": fit_subject,
    "evaluate": evaluate_subject,
}
"""The function of each stage, which returns figures for the summary."""
NEEDED: Mapping[Stage, tuple[str, ...]] = {
    "prepare": (CAPTURE,),
    "lmvs": (CAPTURE, STEREO),
    "fit": (CAPTURE, SEGMENTS, RUN),
    "evaluate": (CAPTURE, RUN),
}
"""Prefixes of the files in a subject's folder that a stage reads."""


def spared(stage: Stage) -> str | None:
    """Prefix of the many files among them that the stage does not read, if any."""
    return None if stage == "prepare" else f"{CAPTURE}/{PREPARATION}/"


def _write_thumbnail(picture: Path, path: Path) -> None:
    pixels = read_pixels(picture)
    width = min(THUMBNAIL_WIDTH, pixels.shape[1])
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    write_png(path, cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA))


def _figure(figures: Any, path: str) -> float | None:
    """A figure by its path, if it is there and finite."""
    for name in path.split("."):
        figures = figures.get(name) if isinstance(figures, dict) else None
    return float(figures) if isinstance(figures, int | float) and math.isfinite(figures) else None
