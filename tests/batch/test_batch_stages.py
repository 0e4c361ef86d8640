"""What a stage of a batch passes on to the command of the same name."""

from pathlib import Path

import pytest
import torch

from neural_strands.batch import stages
from neural_strands.batch.stages import StageWork, prepare_subject
from neural_strands.batch.subjects import PrepareSettings, Subject
from neural_strands.foundation.progress import Feedback
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.head.fit import KnownSize
from neural_strands.preparation.head.request import HeadRequest
from neural_strands.preparation.request import PrepareRequest


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[PrepareRequest]:
    """The requests for preparations, none of which is carried out."""
    requests: list[PrepareRequest] = []

    def prepare(request: PrepareRequest, _: object) -> dict:
        requests.append(request)
        return {"cameras": 7}

    monkeypatch.setattr(stages, "prepare", prepare)
    return requests


def prepared(folder: Path, options: PrepareSettings) -> dict[str, float]:
    subject = Subject("bob", "in/photos", prepared=False, prepare=options)
    return prepare_subject(StageWork(subject, folder, torch.device("cpu"), Feedback()))


def test_every_option_of_a_preparation_arrives(tmp_path: Path, asked: list[PrepareRequest]):
    options = PrepareSettings(
        cameras="in/cameras",
        landmarks="in/landmarks.json",
        masks="in/masks",
        template="in/template.obj",
        scalp="in/scalp.json",
        detector="in/python",
        scale=0.4,
        pupil_distance=62.0,
        longest_side=512,
        frames=9,
        bend=False,
    )
    assert prepared(tmp_path, options) == {"views": 7.0}
    head = HeadRequest(
        landmarks=Path("in/landmarks.json"),
        template=Path("in/template.obj"),
        scalp=Path("in/scalp.json"),
        size=KnownSize(metres_per_unit=0.4, pupil_distance=0.062),
        detector=Detector(python=Path("in/python")),
        bend=False,
    )
    expected = PrepareRequest(
        photographs=Path("in/photos"),
        out=tmp_path / "capture",
        cameras=Path("in/cameras"),
        masks=Path("in/masks"),
        longest_side=512,
        frames=9,
        head=head,
    )
    assert asked == [expected]


def test_without_options_a_preparation_is_that_of_the_command(tmp_path: Path, asked: list[PrepareRequest]):
    prepared(tmp_path, PrepareSettings())
    assert asked == [PrepareRequest(Path("in/photos"), tmp_path / "capture")]
