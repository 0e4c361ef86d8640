"""Stages run once, run again when an input changes, and leave nothing behind if they fail."""

import json
from pathlib import Path

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.face.files import read_faces
from neural_strands.preparation.photographs.folder import Photograph, read_list
from neural_strands.preparation.stage import digest_files, run_stage


def test_a_stage_is_done_once_for_the_same_inputs(tmp_path: Path):
    calls = []

    def work(folder: Path):
        calls.append(folder)
        (folder / "result").write_text(str(len(calls)))

    first, worked = run_stage(tmp_path / "a", {"x": 1, "y": "b"}, work)
    assert worked
    again, worked = run_stage(tmp_path / "a", {"y": "b", "x": 1}, work)
    assert not worked
    assert again == first
    other, worked = run_stage(tmp_path / "a", {"x": 2, "y": "b"}, work)
    assert worked
    assert other.digest != first.digest
    assert (tmp_path / "a" / "result").read_text() == "2"


def test_a_stage_that_fails_leaves_what_was_there(tmp_path: Path):
    def work(folder: Path) -> None:
        (folder / "result").write_text("old")

    run_stage(tmp_path / "a", {"x": 1}, work)

    def fail(folder: Path):
        (folder / "result").write_text("half")
        raise InputError("no face")

    with pytest.raises(InputError, match="no face"):
        run_stage(tmp_path / "a", {"x": 2}, fail)
    assert (tmp_path / "a" / "result").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert not run_stage(tmp_path / "a", {"x": 1}, fail)[1]


def test_a_digest_tells_names_and_contents_apart(tmp_path: Path):
    for name, text in (("a", "1"), ("b", "1"), ("c", "2")):
        (tmp_path / name).write_text(text)
    digests = {digest_files([tmp_path / name]) for name in "abc"}
    assert len(digests) == 3
    assert digest_files([tmp_path / "a"]) in digests


def test_a_missing_file_is_one_sentence(tmp_path: Path):
    stage, _ = run_stage(tmp_path / "a", {}, lambda folder: (folder / "mask.png").touch())
    assert stage.file("mask.png") == tmp_path / "a" / "mask.png"
    with pytest.raises(InputError, match=r"b\.png: expected a file of this stage, found none; remove its folder"):
        stage.file("b.png")
    with pytest.raises(InputError, match=r"b\.png: expected a file, but it cannot be read \(No such file"):
        digest_files([stage.folder / "b.png"])


def shot(**changes: object) -> str:
    """A list of one photograph, with some of its values replaced."""
    return json.dumps([{"name": "a.png", "source": "a.jpg", "width": 8, "height": 6} | changes])


DAMAGES = ("", "{", "[1, 2]", '{"a.png": [[1, 2]]}', '{"a.png": [[[1, 2], [3, 4]]]}', '[{"name": 3}]')
NO_PHOTOGRAPHS = (
    *(shot(name=name) for name in ("../../a.png", "/a.png", "..", "", "b/a.png")),
    *(shot(width=0), shot(height=-6), shot(scale=0.0), shot(focal=-1.0)),
    "[]",
    json.dumps(2 * json.loads(shot())),
)


def test_a_list_of_photographs_is_read(tmp_path: Path):
    (tmp_path / "photographs.json").write_text(shot())
    assert read_list(tmp_path) == [Photograph("a.png", "a.jpg", 8, 6)]


@pytest.mark.parametrize("damage", NO_PHOTOGRAPHS)
def test_impossible_photographs_are_one_sentence(tmp_path: Path, damage: str):
    (tmp_path / "photographs.json").write_text(damage)
    with pytest.raises(InputError, match=r"expected .*the stage is done again"):
        read_list(tmp_path)


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_files_of_a_stage_are_one_sentence(tmp_path: Path, damage: str):
    for name, read in (("photographs.json", read_list), ("faces.json", lambda folder: read_faces(folder, ["a.png"]))):
        (tmp_path / name).write_text(damage)
        with pytest.raises(InputError, match=r"expected .*the stage is done again"):
            read(tmp_path)
