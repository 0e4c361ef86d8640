"""SIGKILL at a random moment; `benchmarks/kills.py` repeats this many times."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow(seconds=40)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the benchmark forks")
@pytest.mark.parametrize(("job", "files"), [("fit", 4), ("stereo", 20), ("prepare", 50)])
def test_killed_work_ends_in_the_bits_of_work_that_was_left_alone(job, files, tmp_path, request):
    program = Path(request.config.rootpath) / "benchmarks" / "kills.py"
    words = [str(tmp_path / "out"), "--job", job, "--kills", "1", "--seed", "1"]
    done = subprocess.run([sys.executable, str(program), *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["kills"] >= 1
    assert figures["files"] >= files
    assert figures["different"] == []
    assert figures["left"] == []
