"""Freed memory stays with the process after `keep_freed_memory`, and is returned without it."""

import platform
import subprocess
import sys
from pathlib import Path

import pytest

from neural_strands.foundation.memory import free_memory, keep_freed_memory, peak_resident_memory

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


LIMITED = """
import resource, sys
from neural_strands.foundation.memory import free_memory
mapped = resource.getpagesize() * int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (mapped + 300_000_000, resource.RLIM_INFINITY))
print(free_memory())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says what is free")
def test_what_is_free_is_what_can_be_taken():
    whole = 1024 * int(Path("/proc/meminfo").read_text().partition("MemTotal:")[2].split()[0])
    swap = 1024 * int(Path("/proc/meminfo").read_text().partition("SwapTotal:")[2].split()[0])
    free = free_memory()
    assert free is not None
    assert 0 < free < whole + swap
    done = subprocess.run([sys.executable, "-c", LIMITED], capture_output=True, text=True, check=True)
    assert int(done.stdout) == pytest.approx(3e8, rel=0.05)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux says what is free")
def test_a_container_may_allow_less(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("neural_strands.foundation.memory.CONTAINER", tmp_path)
    (tmp_path / "memory.max").write_text("5000000\n")
    (tmp_path / "memory.current").write_text("3000000\n")
    assert free_memory() == 2_000_000
    (tmp_path / "memory.max").write_text("max\n")
    free = free_memory()
    assert free is not None
    assert free > 5_000_000


def test_another_library_is_left_alone(monkeypatch):
    monkeypatch.setattr("neural_strands.foundation.memory.sys.platform", "darwin")
    assert keep_freed_memory() is False


PEAK = """
import sys
from neural_strands.foundation.memory import peak_resident_memory
block = bytes(range(256)) * (int(sys.argv[1]) // 256)
del block
print(peak_resident_memory())
"""


def peak_of(size: int) -> int:
    done = subprocess.run([sys.executable, "-c", PEAK, str(size)], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows reports no peak")
def test_the_peak_remembers_what_was_freed():
    assert peak_of(200_000_000) - peak_of(256) == pytest.approx(2e8, rel=0.05)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems report it by getrusage alone")
def test_the_peak_leaves_out_the_process_that_started_this_one():
    block = bytes(range(256)) * 1_000_000
    assert peak_of(256) < len(block) < peak_resident_memory()
