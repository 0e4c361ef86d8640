"""`view`, run as a user runs it, on paths that it cannot show."""

import re
import threading
from pathlib import Path

import pytest

from neural_strands.cli.main import main


@pytest.mark.parametrize("name", ["photos", "notes.txt", "absent", "photos/a.jpg"])
def test_what_cannot_be_shown_is_refused_before_an_address_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture, name: str
):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").touch()
    (tmp_path / "notes.txt").write_text("hair")
    before = set(threading.enumerate())
    assert main(["view", str(tmp_path / name), "--port", "0"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert re.search(rf"{re.escape(str(tmp_path / name))}: expected .*, found .*; ", said.err)
    # The server's threads have ended.
    assert set(threading.enumerate()) <= before


def test_the_address_of_what_can_be_shown_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture):
    (tmp_path / "transforms.json").write_text("{}")
    # Of a capture, only the file of its cameras is looked for: the page is there before anything is read.
    assert main(["view", str(tmp_path), "--port", "0"]) == 2
    said = capsys.readouterr()
    assert re.fullmatch(r"open http://127\.0\.0\.1:\d+ in a browser; Ctrl-C ends this\n", said.out)
    assert "transforms.json" in said.err
