"""The detector's process: answers are read, failures give one sentence. MediaPipe itself is tested if installed."""

import hashlib
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.published_files import FOLDER_VARIABLE, PublishedFile
from neural_strands.preparation.face import detector as detector_module
from neural_strands.preparation.face.detector import Detector
from neural_strands.preparation.face.files import read_faces, read_marks, write_faces
from neural_strands.preparation.face.topology import FACE_OVAL, INTERIOR, LANDMARKS, NAMED

REAL_PYTHON = "NEURAL_STRANDS_MEDIAPIPE"
"""Environment variable with a Python that has mediapipe."""


def stand_in(tmp_path: Path, body: str) -> Path:
    """A program that answers instead of a Python with MediaPipe."""
    path = tmp_path / "python"
    path.write_text(f"#!{sys.executable}\nimport json, sys\nrequest = json.load(sys.stdin)\n{body}\n")
    path.chmod(0o755)
    return path


def test_answers_come_back_in_order(tmp_path: Path):
    body = (
        "for k, image in enumerate(request['images']):\n"
        "    print(json.dumps({'image': image, 'faces': [[[k, 1.5]] * 468] * k}), flush=True)"
    )
    detector = Detector(stand_in(tmp_path, body))
    found = detector.detect([tmp_path / "a.png", tmp_path / "b.png", tmp_path / "c.png"])
    assert [len(faces) for faces in found] == [0, 1, 2]
    assert found[1][0].shape == (LANDMARKS, 2)
    np.testing.assert_array_equal(found[2][1][467], [2, 1.5])
    # A model without irises leaves them unknown.
    assert np.isnan(found[2][1][468:]).all()


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("print(json.dumps({'error': 'lacks mediapipe'}))", "lacks mediapipe"),
        ("sys.exit('the model is damaged')", "the model is damaged"),
        ("sys.exit(3)", "exit status 3"),
    ],
)
def test_a_detector_that_fails_is_one_sentence(tmp_path: Path, body: str, reason: str):
    with pytest.raises(InputError, match=reason):
        Detector(stand_in(tmp_path, body)).detect([tmp_path / "a.png"])


def test_models_that_mediapipe_lacks_are_fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for name in ("FACE_MODEL", "PERSON_MODEL"):
        content = tmp_path / name
        content.write_text(name)
        digest = hashlib.sha256(name.encode()).hexdigest()
        file = PublishedFile((f"{name}.task",), content.as_uri(), digest, "--option")
        monkeypatch.setattr(detector_module, name, file)
    body = (
        "names = ['face_model', 'person_model'] if request['masks'] else ['face_model']\n"
        "lacking = [name for name in names if request[name] is None]\n"
        "if lacking:\n"
        "    print(json.dumps({'lacking': lacking}))\n"
        "else:\n"
        "    words = [open(request[name]).read() for name in names]\n"
        "    assert words == ['FACE_MODEL', 'PERSON_MODEL'][:len(names)], words\n"
        "    print(json.dumps({'image': '', 'faces': [[[7.0, 1.5]] * 478]}))"
    )
    python = stand_in(tmp_path, body)
    assert Detector(python).detect([tmp_path / "a.png"])[0][0][0, 0] == 7.0
    (tmp_path / "masks").mkdir()
    assert Detector(python).detect([tmp_path / "a.png"], tmp_path / "masks")[0][0][0, 0] == 7.0
    # A given model is not replaced.
    (tmp_path / "given").write_text("FACE_MODEL")
    (tmp_path / "cache" / "neural-strands" / "FACE_MODEL.task").unlink()
    Detector(python, face_model=tmp_path / "given").detect([tmp_path / "a.png"], tmp_path / "masks")
    assert not (tmp_path / "cache" / "neural-strands" / "FACE_MODEL.task").exists()
    (tmp_path / "FACE_MODEL").write_text("another")
    with pytest.raises(InputError, match=r"expected a file with sha256 .*name it with --option"):
        Detector(python).detect([tmp_path / "a.png"])


def test_a_missing_interpreter_is_told_before_work(tmp_path: Path):
    with pytest.raises(InputError, match="expected a file for the face detector"):
        Detector(tmp_path / "absent").check()


def test_faces_round_trip(tmp_path: Path):
    face = np.round(np.random.default_rng(0).uniform(0, 500, (LANDMARKS, 2)), 3)
    face[470] = np.nan
    write_faces(tmp_path, ["a.png", "b.png"], [[face], []])
    first, second = read_faces(tmp_path, ["a.png", "b.png"])
    np.testing.assert_array_equal(first[0], face)
    assert second == []


def test_faces_keep_their_pictures_whatever_these_are_called(tmp_path: Path):
    face = np.full((LANDMARKS, 2), 1.5)
    face[7] = np.nan
    write_faces(tmp_path, ["KaNaNa.png"], [[face]])
    ((found,),) = read_faces(tmp_path, ["KaNaNa.png"])
    np.testing.assert_array_equal(found, face)


def as_it_is(_: str, pixels: np.ndarray) -> np.ndarray:
    return pixels


def test_landmarks_set_by_hand(tmp_path: Path):
    path = tmp_path / "marks.json"
    path.write_text(json.dumps({"A.JPG": {"nose_tip": [10, 20.5], "33": [1, 2]}}))
    marked, bare = read_marks(path, ["a.png", "b.png"], as_it_is)
    assert bare == []
    np.testing.assert_array_equal(marked[0][[NAMED["nose_tip"], 33]], [[10, 20.5], [1, 2]])
    assert np.isnan(np.delete(marked[0], [NAMED["nose_tip"], 33], axis=0)).all()


@pytest.mark.parametrize("suffix", ["", ".JPG", ".png"])
def test_names_of_marked_photographs_may_tell_the_time(tmp_path: Path, suffix: str):
    path = tmp_path / "marks.json"
    times = [f"2026-05-01 14.30.{seconds}" for seconds in (22, 25)]
    path.write_text(json.dumps({f"{time}{suffix}": {"33": [k, 2]} for k, time in enumerate(times)}))
    found = read_marks(path, [f"{time}.png" for time in times], as_it_is)
    assert [face[33].tolist() for (face,) in found] == [[0, 2], [1, 2]]


def test_names_of_marked_photographs_may_have_folders(tmp_path: Path):
    path = tmp_path / "marks.json"
    path.write_text(json.dumps({"right/1.jpg": {"33": [1, 2]}, "left/1": {"33": [3, 4]}, "2.jpg": {"33": [5, 6]}}))
    found = read_marks(path, ["left/1.jpg", "right/1.jpg", "left/2.jpg", "left/3.jpg"], as_it_is)
    assert [[face[33].tolist() for face in faces] for faces in found] == [[[3, 4]], [[1, 2]], [[5, 6]], []]


def test_marks_belong_to_the_photograph_of_exactly_their_name(tmp_path: Path):
    path = tmp_path / "marks.json"
    path.write_text(json.dumps({"1.png": {"33": [1, 2]}, "1.jpg": {"33": [3, 4]}}))
    found = read_marks(path, ["1.jpg", "1.png"], as_it_is)
    assert [face[33].tolist() for (face,) in found] == [[3, 4], [1, 2]]


def test_marks_that_may_be_of_several_photographs_are_refused(tmp_path: Path):
    path = tmp_path / "marks.json"
    path.write_text(json.dumps({"1.jpg": {"33": [1, 2]}}))
    with pytest.raises(InputError, match=r"found '1.jpg', which left/1.jpg and right/1.jpg share; write the folder"):
        read_marks(path, ["left/1.jpg", "right/1.jpg"], as_it_is)
    path.write_text(json.dumps({"1.jpg": {"33": [1, 2]}, "1": {"33": [3, 4]}}))
    with pytest.raises(InputError, match=r"landmarks of 1.png once, found '1.jpg' and '1'; remove one"):
        read_marks(path, ["1.png"], as_it_is)


def test_landmarks_follow_the_photograph_to_its_picture(tmp_path: Path):
    path = tmp_path / "marks.json"
    path.write_text(json.dumps({"a.jpg": {"33": [8, 4]}, "b.jpg": {"33": [8, 4]}}))
    (first,), (second,) = read_marks(path, ["a.png", "b.png"], lambda name, at: at * (0.5 if name == "a.png" else 1.0))
    np.testing.assert_array_equal(first[33], [4, 2])
    np.testing.assert_array_equal(second[33], [8, 4])
    assert np.isnan(first[34]).all()


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ({"a": {"nostril": [1, 2]}}, "found .nostril"),
        ({"a": {"478": [1, 2]}}, "found .478"),
        ({"a": {"chin": [1]}}, "a.chin: expected finite numbers in lists of size 2"),
        ({"a": {"chin": ["x", True]}}, "a.chin: expected finite numbers"),
        ({"other": {"chin": [1, 2]}}, "found them on 1 others"),
        ([1], "expected an object"),
        ("[" * 100000, "nested too deeply"),
    ],
)
def test_wrong_landmark_files_are_one_sentence(tmp_path: Path, document, complaint: str):
    path = tmp_path / "marks.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    with pytest.raises(InputError, match=complaint) as caught:
        read_marks(path, ["a.png"], as_it_is)
    assert "\n" not in str(caught.value)


def test_the_topology_is_sound():
    assert not set(INTERIOR) & set(FACE_OVAL)
    assert len(set(NAMED.values())) == len(NAMED)
    assert max(NAMED.values()) < LANDMARKS


def test_the_real_detector_finds_faces(tmp_path: Path, shared_data: Path):
    python = os.environ.get(REAL_PYTHON)
    if python is None:
        pytest.skip(f"{REAL_PYTHON} names no Python with mediapipe")
    pictures = sorted((shared_data / "photos" / "face" / "images").glob("*.jpg"))[::13]
    (tmp_path / "person").mkdir()
    found = Detector(Path(python)).detect(pictures, tmp_path / "person")
    assert [len(faces) for faces in found] == [1] * len(pictures)
    for (face,) in found:
        assert face.shape == (LANDMARKS, 2)
        # Eyes above the mouth, the person's right to the left of the picture: the photographs lie as stored.
        assert np.isfinite(face).all()
    assert len(list((tmp_path / "person").glob("*.png"))) == len(pictures)
