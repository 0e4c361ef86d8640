"""In programs, idle threads soon go to sleep, unless the user has chosen otherwise."""

import os
import subprocess
import sys

import pytest

from neural_strands.foundation.threads import CHOICES, SPINS, sleep_when_idle

PROGRAM = """
import os, sys
from neural_strands.cli.main import main
assert main(["info", "missing.npz"]) == 2
print(os.environ["GOMP_SPINCOUNT"])
"""


def free_environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if name not in CHOICES}


def test_the_command_line_says_so_to_torch():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, env=free_environment()
    )
    assert done.stdout.strip() == str(SPINS)


@pytest.mark.parametrize("name", CHOICES)
def test_what_the_user_chose_stays(name, monkeypatch):
    monkeypatch.delitem(sys.modules, "torch")
    for other in CHOICES:
        monkeypatch.delenv(other, raising=False)
    monkeypatch.setenv(name, "7")
    before = dict(os.environ)
    assert not sleep_when_idle()
    assert dict(os.environ) == before


def test_it_is_too_late_once_torch_is_loaded(monkeypatch):
    for name in CHOICES:
        monkeypatch.delenv(name, raising=False)
    assert "torch" in sys.modules
    assert not sleep_when_idle()
    assert "GOMP_SPINCOUNT" not in os.environ
