"""Stages run once, run again when an input changes, and leave nothing behind if they fail."""

from pathlib import Path

import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.face.files import read_faces
from neural_strands.preparation.photographs.folder import read_list
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


@pytest.mark.parametrize("damage", ["", "{", "[1, 2]", '{"a.png": [[1, 2]]}', '[{"name": 3}]'])
def test_damaged_files_of_a_stage_are_one_sentence(tmp_path: Path, damage: str):
    for name, read in (("photographs.json", read_list), ("faces.json", lambda folder: read_faces(folder, ["a.png"]))):
        (tmp_path / name).write_text(damage)
        with pytest.raises(InputError, match=r"expected .*run prepare again"):
            read(tmp_path)
