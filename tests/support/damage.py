"""Damage to files for the tests of readers: noise, cuts, insertions, and claims about sizes."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from neural_strands.foundation.errors import InputError

CLAIMS = [0, 1, 0x7FFFFFFF, 0xEE6B2800, 0xFFFFFFFF, 0x7FC00000, 2**40, 2**63 - 1]
"""Counts and a NaN with which a field may be overwritten."""
WORDS = [b"4000000000", b"-1", b"nan", b"1e999", b"", b"l", b"/", b"null", b'"', b"[", b"{", b"\\u0000", b"\x00"]
"""Text that may stand in place of a number."""
EDIT = st.tuples(
    st.integers(0, 10**9),
    st.one_of(
        st.tuples(st.just("replace"), st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("insert"), st.binary(min_size=1, max_size=8)),
        st.tuples(st.just("claim"), st.sampled_from(CLAIMS)),
        st.tuples(st.just("digits"), st.sampled_from(WORDS)),
        st.tuples(st.just("cut"), st.just(0)),
    ),
)
"""One edit of a file."""


def damage(content: bytes, edits: list) -> bytes:
    """The content with some edits."""
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


def merged(values: dict, changes: dict) -> dict:
    """A document with some members changed, at any depth."""
    return values | {
        key: merged(values[key], value) if isinstance(value, dict) else value for key, value in changes.items()
    }


def fuzz(examples: int) -> Callable[[Callable], Callable]:
    """A given number of examples, the same in every run."""
    checks = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    return settings(max_examples=examples, deadline=None, suppress_health_check=checks, derandomize=True, database=None)


def read_or_refuse(path: Path, content: bytes, read: Callable[[Path], object], most: int = 8_000_000) -> str:
    """Read a file with this content: the outcome is a result or one sentence, without a huge allocation."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    tracemalloc.start()
    try:
        read(path)
        refusal = ""
    except InputError as error:
        refusal = str(error)
        assert refusal.startswith(f"{path}: ")
        assert refusal.endswith(".")
        assert refusal.isprintable()
        assert len(refusal) < len(str(path)) + 800
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < most
    return refusal
