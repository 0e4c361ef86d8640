"""The driver of damaged files tells a process that hangs from one that has not begun to read."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest


@pytest.fixture(scope="module")
def fuzz(benchmark_module: Callable[[str, str], ModuleType]) -> ModuleType:
    return benchmark_module("", "fuzz")


@pytest.mark.parametrize("hangs", [False, True])
def test_a_process_that_starts_slowly_is_not_taken_for_one_that_hangs(
    fuzz: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hangs: bool
):
    reader = SimpleNamespace(name="tiny", file="a.txt")
    corpus, out = tmp_path / "corpus", tmp_path / "out"
    for folder in (corpus, out):
        folder.mkdir()
    (corpus / "a.txt").write_text("valid")
    current = out / "tiny.current"

    def begin_long_ago() -> None:
        current.write_text("0")
        os.utime(current, (0, 0))

    class Process:
        """Looked at three times until it has read its only file, unless it hangs before that."""

        returncode: int | None = None
        looks = 0

        def poll(self) -> int | None:
            self.looks += 1
            if hangs and self.looks == 1:
                begin_long_ago()
            if self.returncode is None and self.looks == 3:
                fuzz.Tally("tiny", 0, inputs=1).save(out)
                self.returncode = 0
            return self.returncode

        def kill(self) -> None:
            self.returncode = -9

    # An earlier process, which was stopped, has left this.
    begin_long_ago()
    monkeypatch.setattr(subprocess, "Popen", lambda _: Process())
    monkeypatch.setattr(fuzz.time, "sleep", lambda _: None)
    tally = fuzz.drive(reader, corpus, out, 0, 1, float("inf"))
    assert tally.inputs == 1
    assert dict(tally.outcomes) == ({"died": 1} if hangs else {})
