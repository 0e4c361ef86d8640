"""JSON from untrusted files: the expected values, or one sentence."""

import gzip
import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from damage import EDIT, damage, fuzz, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.json_files import JsonValue, parse_json, read_json

DOCUMENT = {"frames": [{"fl_x": 50.5, "w": 512, "name": "ä.png", "odd key": True}], "pose": [[1, 2], [3, 4.5]]}


def read(path: Path) -> JsonValue:
    return read_json(path, "cameras", "export them again")


def test_values_come_back(tmp_path):
    (tmp_path / "a.json").write_text(json.dumps(DOCUMENT), encoding="utf-8-sig")
    (tmp_path / "a.json.gz").write_bytes(gzip.compress(json.dumps(DOCUMENT).encode()))
    for name in ("a.json", "a.json.gz"):
        top = read(tmp_path / name)
        (frame,) = top.member("frames").elements()
        assert frame.member("fl_x").number() == 50.5
        assert frame.member("w").whole(1, 1000) == 512
        assert frame.member("name").text() == "ä.png"
        assert frame.member("odd key").flag() is True
        assert frame.optional("mask") is None
        assert list(top.members()) == ["frames", "pose"]
        assert np.array_equal(top.member("pose").array(2, None), [[1, 2], [3, 4.5]])
        assert top.value == DOCUMENT
    assert JsonValue(512.0, "a").whole(1, 1000) == 512
    assert JsonValue([3, 1], "a").wholes(0, 3) == [3, 1]
    assert JsonValue("b", "a").choice(["a", "b"]) == "b"


@pytest.mark.parametrize(
    ("content", "take", "message"),
    [
        ('{"a": [{"b": "wide"}]}', lambda v: v.member("a").elements()[0].member("b").number(), r"a\[0\]\.b: expected"),
        ('{"a b": 1}', lambda v: v.member("a b").text(), r"\['a b'\]: expected a text"),
        ('{"a": 1}', lambda v: v.member("b"), r"expected a value under 'b', found \['a'\]"),
        ("[1]", lambda v: v.member("b"), "expected an object"),
        ("true", lambda v: v.number(), "expected a finite number, found True"),
        ("1e400", lambda v: v.number(), "expected a finite number, found inf"),
        ("1" + "0" * 400, lambda v: v.number(), "expected a finite number"),
        ("1" + "0" * 5000, lambda v: v, "expected cameras as JSON"),
        ("3", lambda v: v.number(0.0, 2.0), "from 0.0 to 2.0, found 3"),
        ("-1", lambda v: v.number(low=0.0), "of at least 0.0, found -1"),
        ("1.5", lambda v: v.whole(0, 9), "whole number from 0 to 9, found 1.5"),
        ("18446744073709551616", lambda v: v.whole(0, 9), "whole number"),
        ("Infinity", lambda v: v, "Infinity, which is no number"),
        ('"a\\u0000"', lambda v: v.text(), "without control characters"),
        ('"\\ud800"', lambda v: v.text(), "without control characters"),
        (json.dumps("x" * 2000), lambda v: v.text(), "at most 1000 letters"),
        ("1", lambda v: v.flag(), "true or false"),
        ('"c"', lambda v: v.choice(["a", "b"]), "one of a, b, found 'c'"),
        ("[[1, 2], [3]]", lambda v: v.array(None, 2), "finite numbers in lists of size any x 2"),
        ('[["1", "2"]]', lambda v: v.array(None, 2), "finite numbers"),
        ("[[true, false]]", lambda v: v.array(None, 2), "finite numbers"),
        ("[1e400, 2]", lambda v: v.array(2), "finite numbers"),
        ("[0, 7, -1]", lambda v: v.wholes(0, 9), r"\[2\]: expected a whole number from 0 to 9, found -1"),
        ("{}", lambda v: v.wholes(0, 9), "list of whole numbers"),
        ('{"a": 1, "a": 2}', lambda v: v, "the name 'a' twice"),
        ("[" * 100_000, lambda v: v, "nested too deeply"),
        ("[" * 900 + "]" * 900, lambda v: v.array(None), "finite numbers|nested too deeply"),
        ("{", lambda v: v, "expected cameras as JSON"),
        ("", lambda v: v, "expected cameras as JSON"),
    ],
)
def test_what_is_wrong_is_one_sentence(tmp_path, content, take, message):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        take(read(tmp_path / "a.json"))
    sentence = str(caught.value)
    assert sentence.startswith(f"{tmp_path / 'a.json'}: ")
    assert sentence.endswith("; export them again.")
    assert sentence.isprintable()
    assert len(sentence) < len(str(tmp_path)) + 300


def test_files_that_are_no_text(tmp_path):
    (tmp_path / "a.json").write_bytes(b"\xff\xfe{}")
    with pytest.raises(InputError, match="UTF-8"):
        read(tmp_path / "a.json")
    whole = gzip.compress(json.dumps(DOCUMENT).encode())
    for content in (b"no", whole[:-12], whole[:20] + b"\xff\xff" + whole[22:], whole + b"junk"):
        (tmp_path / "a.json.gz").write_bytes(content)
        with pytest.raises(InputError, match="gzip"):
            read(tmp_path / "a.json.gz")


def test_a_document_is_bounded_unpacked(tmp_path):
    (tmp_path / "a.json.gz").write_bytes(gzip.compress(b" " * 30_000_000))
    refusal = read_or_refuse(
        tmp_path / "a.json.gz",
        (tmp_path / "a.json.gz").read_bytes(),
        lambda path: read_json(path, "cameras", most=3_000_000),
    )
    assert "at most 3000000 bytes unpacked" in refusal


def test_constants_are_let_through_where_they_are_wanted():
    assert parse_json("[NaN]", "log", "figures", with_constants=True).value[0] != 0
    with pytest.raises(InputError, match="log: expected figures"):
        parse_json("[NaN]", "log", "figures")


def take_everything(value: JsonValue) -> None:
    """Every way to take a value; each returns or refuses it."""
    ways = (JsonValue.number, JsonValue.flag, JsonValue.text, JsonValue.elements, JsonValue.members)
    for way in (*ways, lambda v: v.whole(0, 9), lambda v: v.array(None, 3), lambda v: v.wholes(0, 9)):
        with suppress(InputError):
            way(value)
    parts = value.value if isinstance(value.value, list | dict) else ()
    for part in (value.elements() if isinstance(parts, list) else value.members().values()) if parts else ():
        take_everything(part)


@pytest.mark.parametrize("suffix", [".json", ".json.gz"])
@fuzz(200)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(suffix: str, tmp_path: Path, edits: list):
    content = json.dumps(DOCUMENT).encode()
    content = gzip.compress(content, mtime=0) if suffix.endswith(".gz") else content
    read_or_refuse(tmp_path / f"a{suffix}", damage(content, edits), lambda path: take_everything(read(path)))
