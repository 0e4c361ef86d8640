"""Finds faces and people in pictures with MediaPipe, which may be installed in another environment.

MediaPipe requires particular versions of NumPy and OpenCV, so it often needs an environment of its own, in which
`worker.py` runs. It detects the same 478 landmarks on every face (`topology.py` names those that are used). Its wheels
up to 0.10.21 contain their models; for later ones, the models that its authors publish are fetched once.
"""

import importlib.util
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.progress import track
from neural_strands.foundation.published_files import PublishedFile, find_file
from neural_strands.foundation.worker import started_worker
from neural_strands.preparation.face.topology import LANDMARKS
from neural_strands.preparation.stage import digest_files

WORKER = Path(__file__).with_name("worker.py")
ADVICE = (
    "make an environment for it (`python -m venv mediapipe && mediapipe/bin/pip install mediapipe==0.10.21`) and pass "
    "--detector mediapipe/bin/python, or give the landmarks as a file with --landmarks"
)

MODELS = "https://storage.googleapis.com/mediapipe-models"
FACE_MODEL = PublishedFile(
    ("face_landmarker.task",),
    f"{MODELS}/face_landmarker/face_landmarker/float16/1/face_landmarker.task",
    "64184e229b263107bc2b804c6625db1341ff2bb731874b0bcc2fe6544e0bc9ff",
    "--face-model",
)
PERSON_MODEL = PublishedFile(
    ("selfie_segmenter.tflite",),
    f"{MODELS}/image_segmenter/selfie_segmenter/float16/1/selfie_segmenter.tflite",
    "191ac9529ae506ee0beefa6b2c945a172dab9d07d1e802a290a4e4038226658b",
    "--person-model",
)


@dataclass(frozen=True)
class Detector:
    """Which MediaPipe to use.

    Attributes:
        python: an interpreter that has MediaPipe; this one if None.
        face_model: `face_landmarker.task`; if None, the model inside MediaPipe's wheel, or else the published one.
        person_model: a selfie segmenter (.tflite); if None, the model inside the wheel, or else the published one.
    """

    python: Path | None = None
    face_model: Path | None = None
    person_model: Path | None = None

    def check(self) -> None:
        """Check that interpreter and models exist, before anything is computed.

        Raises:
            InputError: an interpreter or a model is missing.
        """
        for path in (self.python, self.face_model, self.person_model):
            if path is not None and not path.is_file():
                raise InputError(f"{path}: expected a file for the face detector, found none; check the path.")
        if self.python is None and importlib.util.find_spec("mediapipe") is None:
            raise InputError(f"Finding faces: expected the package mediapipe, found none; {ADVICE}.")

    def digests(self) -> list[str | None]:
        """Digests of the models that were chosen, on which all that is found depends.

        Raises:
            InputError: a model cannot be read.
        """
        return [None if path is None else digest_files([path]) for path in (self.face_model, self.person_model)]

    def detect(
        self, pictures: Sequence[Path], masks: Path | None = None, description: str = "finding faces"
    ) -> list[list[np.ndarray]]:
        """Find the faces of each picture.

        Args:
            pictures: PNG or JPEG files.
            masks: an existing folder for masks of the person, one PNG per picture; None makes none.
            description: label of the progress bar.

        Returns:
            For each picture its faces, each (landmark, 2) pixels, pixel centres at +0.5.

        Raises:
            InputError: the detector is missing or failed, or lacks a model that cannot be fetched.
        """
        self.check()
        request = {
            "images": [str(picture.resolve()) for picture in pictures],
            "masks": None if masks is None else str(masks.resolve()),
            "face_model": None if self.face_model is None else str(self.face_model.resolve()),
            "person_model": None if self.person_model is None else str(self.person_model.resolve()),
        }
        found: list[list[np.ndarray]] = []
        with started_worker(self.python, WORKER, request, "mediapipe") as worker:
            for line in track(worker.answers(), description, total=len(pictures)):
                answer = json.loads(line)
                if "error" in answer:
                    raise _failure(answer["error"])
                if "lacking" in answer:
                    return self._with_models(answer["lacking"]).detect(pictures, masks, description)
                found.append([_face(face) for face in answer["faces"]])
            if len(found) < len(pictures):
                raise _failure(worker.last_words())
        return found

    def _with_models(self, lacking: Sequence[str]) -> "Detector":
        """The same with published models for those that MediaPipe lacks, fetched if necessary."""
        published = {"face_model": FACE_MODEL, "person_model": PERSON_MODEL}
        return replace(self, **{name: find_file(published[name]) for name in lacking})


def _failure(found: str) -> InputError:
    return InputError(f"Finding faces: expected MediaPipe to work, found: {found}; {ADVICE}.")


def _face(points: list) -> np.ndarray:
    """Landmarks of one face; models without irises return ten fewer, which become NaN."""
    face = np.full((LANDMARKS, 2), np.nan)
    known = np.asarray(points, dtype=np.float64)[:LANDMARKS]
    face[: len(known)] = known
    return face
