"""Every reader, given noise or damaged files, returns a groom or raises InputError, without huge allocations."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from damage import EDIT, damage, fuzz, read_or_refuse
from groom_makers import make_groom
from hypothesis import given
from hypothesis import strategies as st

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.io import read_groom, write_groom
from neural_strands.grooms.tfx_text import write_tfx_text

FAST = [".hair", ".data", ".tfx", "text.tfx", ".ply", ".obj", ".npz"]
USD = [".usda", ".usdc"]


@cache
def valid(name: str) -> bytes:
    """A small valid file."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"a{Path(f'a{name}').suffix}"
        writer: Callable = write_tfx_text if name == "text.tfx" else write_groom
        groom = make_groom([6] * 5)
        writer(path, groom)
        return path.read_bytes()


def read_whole(path: Path) -> None:
    groom = read_groom(path)
    assert len(groom) > 0
    assert bool(groom.vertices.isfinite().all())


def check(folder: Path, name: str, content: bytes) -> None:
    read_or_refuse(folder / f"a{Path(f'a{name}').suffix}", content, read_whole)


@pytest.mark.parametrize("name", FAST)
@fuzz(60)
@given(content=st.binary(max_size=400), keep_start=st.integers(0, 200))
def test_noise(name: str, tmp_path: Path, content: bytes, keep_start: int):
    check(tmp_path, name, valid(name)[:keep_start] + content)


@pytest.mark.parametrize("name", FAST)
@fuzz(150)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(name: str, tmp_path: Path, edits: list):
    check(tmp_path, name, damage(valid(name), edits))


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
    check(tmp_path, name, damage(valid(name), edits))


def test_usd_chatter_stays_away(tmp_path: Path, capfd: pytest.CaptureFixture):
    for edits in ([(900, ("claim", 2**40))], [(1000, ("cut", 0))], [(500, ("replace", b"\xff" * 8))]):
        check(tmp_path, ".usdc", damage(valid(".usdc"), edits))
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err == ""
