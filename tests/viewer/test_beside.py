import sys
import time

from neural_strands.viewer import beside

DEAF = """#!/bin/sh
trap '' TERM
touch "$0.ready"
while :; do sleep 0.05; done
"""


def test_a_page_that_does_not_end_when_asked_is_ended(tmp_path, monkeypatch):
    program = tmp_path / "python"
    program.write_text(DEAF)
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    monkeypatch.setattr(beside, "PATIENCE", 0.2)
    began = time.monotonic()
    with beside.page_beside(tmp_path / "run"):
        while not (tmp_path / "python.ready").exists():
            assert time.monotonic() - began < 60
            time.sleep(0.01)
    # Leaving the block neither fails nor waits for the program, which would never end.
