"""Every reader, fed noise or damaged files, gives a groom or an InputError: nothing else, and no huge allocation."""

import tracemalloc
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from groom_makers import make_groom
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.io import read_groom, write_groom
from neural_strands.grooms.tfx_text import write_tfx_text

LARGEST_PEAK = 8_000_000
"""Bytes that reading a file of a few kilobytes may take at most."""
FAST = [".hair", ".data", ".tfx", "text.tfx", ".ply", ".obj", ".npz"]
USD = [".usda", ".usdc"]
CLAIMS = [0, 1, 0x7FFFFFFF, 0xEE6B2800, 0xFFFFFFFF, 0x7FC00000, 2**40, 2**63 - 1]
"""Counts and a NaN that a field may be overwritten with."""
EDIT = st.tuples(
    st.integers(0, 10**9),
    st.one_of(
        st.tuples(st.just("replace"), st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("insert"), st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("claim"), st.sampled_from(CLAIMS)),
        st.tuples(st.just("digits"), st.sampled_from([b"4000000000", b"-1", b"nan", b"1e999", b"", b"l", b"/"])),
        st.tuples(st.just("cut"), st.just(0)),
    ),
)


@cache
def valid(name: str) -> bytes:
    """A small valid file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a{Path(f'a{name}').suffix}"
        writer: Callable = write_tfx_text if name == "text.tfx" else write_groom
        groom = make_groom([6] * 5)
        writer(path, groom)
        return path.read_bytes()


def damage(content: bytes, edits: list) -> bytes:
    for place, (kind, value) in edits:
        at = place % (len(content) + 1)
        if kind == "cut":
            content = content[:at]
        elif kind == "insert":
            content = content[:at] + value + content[at:]
        else:
            new = value.to_bytes(8, "little")[: 4 if value < 2**32 else 8] if kind == "claim" else value
            content = content[:at] + new + content[at + len(new) :]
    return content


def read_or_refuse(folder: Path, name: str, content: bytes) -> None:
    path = folder / f"a{Path(f'a{name}').suffix}"
    path.write_bytes(content)
    tracemalloc.start()
    try:
        groom = read_groom(path)
        assert len(groom) > 0
        assert bool(groom.vertices.isfinite().all())
        refusal = f"{path}: none"
    except InputError as error:
        refusal = str(error)
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < LARGEST_PEAK
    assert refusal.startswith(f"{path}: ")
    assert "\n" not in refusal


def fuzz(examples: int) -> Callable[[Callable], Callable]:
    checks = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    return settings(max_examples=examples, deadline=None, suppress_health_check=checks, derandomize=True, database=None)


@pytest.mark.parametrize("name", FAST)
@fuzz(60)
@given(content=st.binary(max_size=400), keep_start=st.integers(0, 200))
def test_noise(name: str, tmp_path: Path, content: bytes, keep_start: int):
    read_or_refuse(tmp_path, name, valid(name)[:keep_start] + content)


@pytest.mark.parametrize("name", FAST)
@fuzz(150)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(name: str, tmp_path: Path, edits: list):
    read_or_refuse(tmp_path, name, damage(valid(name), edits))


@pytest.mark.parametrize("name", FAST)
def test_every_truncation(name: str, tmp_path: Path):
    """A file cut short is refused wherever it is cut (text: except within its last number)."""
    content = valid(name)
    path = tmp_path / f"a{Path(f'a{name}').suffix}"
    for end in range(0, len(content) - 12, max(1, len(content) // 100)):
        path.write_bytes(content[:end])
        if name == ".obj" and b"\nl " in content[:end]:
            continue  # Whole strands may be left, and a polyline cut short is a polyline.
        with pytest.raises(InputError):
            read_groom(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", USD)
@fuzz(40)
@given(edits=st.lists(EDIT, min_size=1, max_size=3))
def test_damaged_usd(name: str, tmp_path: Path, edits: list):
    """Each example starts a process of its own."""
    read_or_refuse(tmp_path, name, damage(valid(name), edits))


def test_usd_chatter_stays_away(tmp_path: Path, capfd: pytest.CaptureFixture):
    for edits in ([(900, ("claim", 2**40))], [(1000, ("cut", 0))], [(500, ("replace", b"\xff" * 8))]):
        read_or_refuse(tmp_path, ".usdc", damage(valid(".usdc"), edits))
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""
