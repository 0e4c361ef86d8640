"""`prepare` and `fit-head`: what the command line asks for, and what it refuses."""

from pathlib import Path

import pytest

from neural_strands.cli.main import main
from neural_strands.preparation import prepare as module
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

    monkeypatch.setattr(module, "prepare", prepare)
    return requests


def test_every_option_arrives(asked: list[PrepareRequest]):
    words = (
        "prepare photos out --cameras model --masks given --segmenter draw --landmarks marks.json --template head.obj "
        "--scalp scalp.json --detector bin/python --face-model face.task --person-model person.tflite --scale 0.4 "
        "--pupil-distance 62 --longest-side 512 --frames 9 --no-bend --subject-turns --keep-exposure"
    )
    assert main(words.split()) == 0
    head = HeadRequest(
        landmarks=Path("marks.json"),
        template=Path("head.obj"),
        scalp=Path("scalp.json"),
        size=KnownSize(metres_per_unit=0.4, pupil_distance=0.062),
        detector=Detector(Path("bin/python"), Path("face.task"), Path("person.tflite")),
        bend=False,
    )
    expected = PrepareRequest(
        photographs=Path("photos"),
        out=Path("out"),
        cameras=Path("model"),
        masks=Path("given"),
        segmenter="draw",
        longest_side=512,
        frames=9,
        subject_turns=True,
        keep_exposure=True,
        head=head,
    )
    assert asked == [expected]


def test_defaults_are_those_of_the_library(asked: list[PrepareRequest]):
    assert main(["prepare", "photos", "out"]) == 0
    assert asked == [PrepareRequest(Path("photos"), Path("out"))]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("prepare photos out --scale 0", "--scale: expected a finite number from 1e-06 to 1000000.0, found 0"),
        ("prepare photos out --pupil-distance 6.2", "--pupil-distance: expected a finite number from 40.0 to 85.0"),
        (
            "prepare photos out --longest-side 255",
            "--longest-side: expected a whole number from 256 to 16384, found 255",
        ),
        ("prepare photos out --frames 2", "--frames: expected a whole number from 3 to 2000, found 2"),
        ("prepare photos out --scale nan", "--scale: expected a finite number"),
        ("fit-head capture out --scale 1e7", "--scale: expected a finite number from 1e-06 to 1000000.0"),
        ("convert a.usd b.usd --scale 0", "--scale: expected a finite number from 1e-06 to 1000000.0"),
        ("convert a.usd b.usd --points 1", "--points: expected a whole number from 2 to 10000, found 1"),
    ],
)
def test_values_out_of_bounds_are_refused_before_anything_is_read(
    asked: list[PrepareRequest], capsys: pytest.CaptureFixture[str], words: str, sentence: str
):
    assert main(words.split()) == 2
    assert sentence in capsys.readouterr().err
    assert asked == []
