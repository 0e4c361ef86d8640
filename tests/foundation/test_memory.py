"""Freed memory stays with the process after `keep_freed_memory`, and is returned without it."""

import platform
import subprocess
import sys

import pytest

from neural_strands.foundation.memory import keep_freed_memory

PROGRAM = """
import ctypes, sys
from neural_strands.foundation.memory import keep_freed_memory

def resident():
    return 4096 * int(open("/proc/self/statm").read().split()[1])

library = ctypes.CDLL(None)
library.malloc.restype = ctypes.c_void_p
library.free.argtypes = [ctypes.c_void_p]
assert sys.argv[1] == "default" or keep_freed_memory()
before = resident()
block = library.malloc(100_000_000)
ctypes.memset(block, 1, 100_000_000)
library.free(block)
print(resident() - before)
"""


def kept_bytes(how: str) -> int:
    done = subprocess.run([sys.executable, "-c", PROGRAM, how], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="keeping freed memory is a parameter of glibc's malloc")
def test_a_freed_block_stays_only_when_asked():
    assert kept_bytes("kept") > 95_000_000
    assert kept_bytes("default") < 20_000_000


def test_another_library_is_left_alone(monkeypatch):
    monkeypatch.setattr("neural_strands.foundation.memory.sys.platform", "darwin")
    assert keep_freed_memory() is False
