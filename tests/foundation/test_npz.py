"""Arrays from untrusted archives: what was written, or one sentence before memory is allocated."""

import io
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
from damage import EDIT, damage, fuzz, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st

from neural_strands.foundation.errors import InputError
from neural_strands.foundation.npz import ArraySpec, array_names, read_npz

SPECS = (
    ArraySpec("points", "point 3", np.float32),
    ArraySpec("curve", "point", np.int64, kinds="iu"),
    ArraySpec("scale", "", np.float64, kinds="fiu", required=False),
    ArraySpec("kept", None, kinds="b", required=False),
)
POINTS = np.arange(12, dtype=np.float32).reshape(4, 3)
CURVE = np.array([0, 0, 1, 1])


def read(path: Path) -> dict[str, np.ndarray]:
    return read_npz(path, "curves", SPECS, "run it again")


def archive(compression: int = zipfile.ZIP_STORED, **headers: str) -> bytes:
    """An archive whose arrays have these headers and no content."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as target:
        for name, header in headers.items():
            text = header.encode() + b"\n"
            target.writestr(f"{name}.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text)
    return buffer.getvalue()


def header(shape: str = "(4, 3)", dtype: str = "'<f4'") -> str:
    return f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}, }}"


def good(**changes) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **({"points": POINTS, "curve": CURVE} | changes))
    return buffer.getvalue()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_come_back(tmp_path, save):
    kept = np.array([[True], [False]])
    save(tmp_path / "a.npz", points=POINTS, curve=CURVE, scale=np.float64(0.5), kept=kept, other=np.array(["text"]))
    found = read(tmp_path / "a.npz")
    for name, value in {"points": POINTS, "curve": CURVE, "scale": np.float64(0.5), "kept": kept}.items():
        assert np.array_equal(found[name], value)
        assert found[name].dtype == value.dtype
        assert found[name].flags.writeable
        assert found[name].flags.c_contiguous
    assert array_names(tmp_path / "a.npz") == {"points", "curve", "scale", "kept", "other"}


@pytest.mark.parametrize("dtype", [">f4", "<f8", "<f2"])
def test_any_float_becomes_what_is_asked_for(tmp_path, dtype):
    np.savez(tmp_path / "a.npz", points=np.asfortranarray(POINTS.astype(dtype)), curve=CURVE.astype(">u2"))
    found = read(tmp_path / "a.npz")
    assert found["points"].dtype == np.float32
    assert np.array_equal(found["points"], POINTS)
    assert found["curve"].dtype == np.int64
    assert np.array_equal(found["curve"], CURVE)


def test_empty_arrays(tmp_path):
    np.savez(tmp_path / "a.npz", points=POINTS[:0], curve=CURVE[:0])
    assert read(tmp_path / "a.npz")["points"].shape == (0, 3)


BOMB = good(points=np.zeros((2_000_000, 3), np.float32), curve=np.zeros(2_000_000, np.int64))
BAD = {
    "no archive": (b"no", "expected curves .*broken"),
    "empty": (b"", "expected curves"),
    "no directory": (good()[:-30], "expected curves"),
    "bad compressed data": (good()[:70] + b"\xff\xff\xff" + good()[73:], "byte 0: expected curves"),
    "missing array": (archive(points=header("(0, 3)")), "an array curve, found 'points'"),
    "pickled": (good(points=np.array([{}], dtype=object)), "of plain numbers"),
    "axes": (good(points=POINTS[0]), r"points of floats in shape \(point, 3\), found 'float32 \(3,\)'"),
    "side": (good(points=POINTS[:, :2]), r"points of floats in shape \(point = 4, 3\)"),
    "disagreeing": (good(curve=CURVE[:3]), r"curve of whole numbers or unsigned numbers in shape \(point = 4\)"),
    "kind": (good(curve=CURVE.astype(np.float32)), "curve of whole numbers"),
    "text": (good(points=np.array([["a", "b", "c"]])), "of plain numbers"),
    "complex": (good(points=POINTS.astype(np.complex64)), "of plain numbers"),
    "nan": (good(points=np.where(POINTS == 7, np.nan, POINTS)), r"finite numbers in points, found nan at \[2, 1\]"),
    "too large for float32": (good(points=np.full((4, 3), 1e300)), "finite numbers in points, found inf"),
    "too large for int64": (good(curve=np.full(4, 2**63, np.uint64)), "curve within int64"),
    "claim": (archive(points=header("(1000000000, 100, 3)"), curve=header("(4,)", "'<i8'")), "as its shape says"),
    "negative": (archive(points=header("(-4, -3)"), curve=header("(4,)", "'<i8'")), "as its shape says"),
    "long claim": (archive(points=header(f"({'9' * 3000}, 3)"), curve=header()), "as its shape says"),
    "braces": (archive(points="{" * 4000, curve=header()), "expected curves"),
    "brackets": (archive(points="(" * 9000, curve=header()), "expected curves"),
    "long header": (archive(points=" " * 60_000, curve=header()), "expected curves"),
    "strange type": (archive(points=header(dtype="5"), curve=header()), "expected curves"),
    "call": (archive(points=header("(1)(2)"), curve=header()), "expected curves"),
    "LZMA": (archive(zipfile.ZIP_LZMA, points=header(), curve=header()), "stored or deflated"),
    "bzip2": (archive(zipfile.ZIP_BZIP2, points=header(), curve=header()), "stored or deflated"),
    "bomb": (BOMB, "of a sane size"),
    "version": (archive(points=header(), curve=header()).replace(b"NUMPY\x01", b"NUMPY\x09"), "version|broken"),
}


@pytest.mark.parametrize("name", sorted(BAD))
def test_what_is_wrong_is_one_sentence(tmp_path, name):
    content, message = BAD[name]
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read(tmp_path / "a.npz")
    refusal = read_or_refuse(tmp_path / "a.npz", content, read, most=4_000_000)
    assert refusal.endswith("; run it again.")


def test_an_array_twice(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as target:
        target.writestr("points.npy", b"")
        target.writestr("points", b"")
    with pytest.raises(InputError, match="'points' twice"):
        read(tmp_path / "a.npz")


def test_names_of_what_is_no_archive(tmp_path):
    (tmp_path / "a.npz").write_bytes(good()[:-30])
    assert array_names(tmp_path / "a.npz") == array_names(tmp_path / "b.npz") == array_names(tmp_path) == set()


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@fuzz(300)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(save, tmp_path: Path, edits: list):
    buffer = io.BytesIO()
    save(buffer, points=POINTS, curve=CURVE, scale=np.float64(2))
    read_or_refuse(tmp_path / "a.npz", damage(buffer.getvalue(), edits), read, most=5_000_000)


@fuzz(200)
@given(text=st.text(alphabet="{}()[]',: \\0123456789-<>fiuOVdescrhapn_oTrueFalse\n\"#", max_size=120))
def test_any_header(tmp_path: Path, text: str):
    read_or_refuse(tmp_path / "a.npz", archive(points=text, curve=header("(4,)", "'<i8'")), read, most=5_000_000)
