"""FLAME's pickle: it is read as its owners write it, and nothing in it is executed."""

import pickle
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse
from fuzzed_input import give

from neural_strands.foundation.errors import InputError
from neural_strands.preparation.head.flame import read_flame

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint32)


@pytest.fixture
def wrapper(monkeypatch: pytest.MonkeyPatch):
    """A class of a library that is not installed where the file is read."""
    module = types.ModuleType("chumpy.ch")

    class Ch:
        def __init__(self, x):
            self.x = x

    Ch.__module__, Ch.__qualname__ = "chumpy.ch", "Ch"
    vars(module)["Ch"] = Ch
    monkeypatch.setitem(sys.modules, "chumpy", types.ModuleType("chumpy"))
    monkeypatch.setitem(sys.modules, "chumpy.ch", module)
    return Ch


@pytest.mark.parametrize("protocol", [2, 4])
def test_the_mean_head_is_read(tmp_path: Path, wrapper, monkeypatch: pytest.MonkeyPatch, protocol: int):
    path = tmp_path / "model.pkl"
    content = {
        "v_template": wrapper(VERTICES),
        "f": FACES,
        "J_regressor": scipy.sparse.csc_matrix(np.eye(4)),
        "bs_style": "lbs",
    }
    path.write_bytes(pickle.dumps(content, protocol))
    monkeypatch.delitem(sys.modules, "chumpy.ch")
    mesh = read_flame(path)
    np.testing.assert_array_equal(mesh.vertices, VERTICES)
    np.testing.assert_array_equal(mesh.faces, FACES)


class Trap:
    def __init__(self, path: Path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def test_nothing_is_run(tmp_path: Path):
    trap = tmp_path / "sprung"
    path = tmp_path / "model.pkl"
    path.write_bytes(pickle.dumps({"v_template": VERTICES, "f": FACES, "x": Trap(trap)}))
    np.testing.assert_array_equal(read_flame(path).faces, FACES)
    assert not trap.exists()


@pytest.mark.parametrize(
    "content",
    [
        {"f": FACES},
        {"v_template": "none", "f": FACES},
        {"v_template": VERTICES[:2], "f": FACES},
        {"v_template": VERTICES * np.nan, "f": FACES},
        {"v_template": VERTICES[0], "f": FACES},
        [1, 2],
    ],
)
def test_other_pickles_are_one_sentence(tmp_path: Path, content):
    path = tmp_path / "model.pkl"
    path.write_bytes(pickle.dumps(content))
    with pytest.raises(InputError, match="expected") as caught:
        read_flame(path)
    assert "\n" not in str(caught.value)


def reduced(code: str, order: str, content: bytes) -> bytes:
    """A pickle of two arrays as NumPy writes them, whose type and bytes need not fit."""
    array = b"cnumpy._core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\0\x85C\x01btR"
    kind = f"cnumpy\ndtype\n(V{code}\n\x89\x88tR(K\x03V{order}\nNNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb".encode(
        "latin1"
    )
    state = b"(K\x01K\x01K\x03\x86" + kind + b"\x89C" + bytes([len(content)]) + content + b"tb"
    return b"\x80\x03}(Vv_template\n" + array + state + b"Vf\n" + array + state + b"u."


def test_arrays_are_made_from_their_bytes_alone(tmp_path: Path):
    """NumPy would take the bytes of objects for their addresses."""
    path = tmp_path / "model.pkl"
    for code, order, content, complaint in (
        ("O", "|", bytes(range(24)), "something else than numbers"),
        ("V8", "|", bytes(24), "something else than numbers"),
        ("f8", "\0", bytes(24), "something else than numbers"),
        ("f8", "<", bytes(16), "cannot reshape"),
        ("f8", "<", bytes(23), "multiple of element size"),
    ):
        path.write_bytes(reduced(code, order, content))
        with pytest.raises(InputError, match=complaint):
            read_flame(path)
    path.write_bytes(reduced("f8", "<", np.arange(3.0).tobytes()))
    with pytest.raises(InputError, match="expected faces over finite vertices"):
        read_flame(path)


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x02}r\xf0\xff\xff\x0f.",
        b"\x80\x02}p999999999\n.",
        b"\x80\x05\x96" + (2**40).to_bytes(8, "little") + b".",
        b"\x80\x02K\x01" + b"\x85" * 100_000 + b"}q\0h\0h\0s.",
    ],
)
def test_claims_cost_no_memory(tmp_path: Path, content: bytes):
    (tmp_path / "model.pkl").write_bytes(content)
    outcome = give(read_flame, tmp_path / "model.pkl")
    assert outcome.kind == "refused", outcome
    assert outcome.peak < 20_000_000


def test_damaged_files_are_one_sentence(tmp_path: Path):
    path = tmp_path / "model.pkl"
    whole = pickle.dumps({"v_template": VERTICES, "f": FACES})
    for size in range(0, len(whole), 7):
        path.write_bytes(whole[:size])
        with pytest.raises(InputError, match="FLAME's model"):
            read_flame(path)
