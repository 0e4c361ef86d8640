"""Files that lie are refused in one sentence that names the place, before anything large is allocated."""

import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom, write_groom

BILLIONS = 4_000_000_000
NAN = struct.pack("<f", float("nan"))


def hair(strands: int, points: int, flags: int = 2, segments: int = 1, body: bytes = b"") -> bytes:
    return struct.pack("<4s4I5f88s", b"HAIR", strands, points, flags, segments, 0, 0, 1, 1, 1, b"") + body


def tfx(strands: int, points: int, body: bytes = b"") -> bytes:
    return struct.pack("<f7I128x", 4.0, strands, points, 160, 0, 0, 0, 0) + body


def data(strands: int, *sizes: int) -> bytes:
    parts = [struct.pack("<i", strands)]
    for size in sizes:
        parts.append(struct.pack("<i", size) + np.arange(3 * size, dtype="<f4").tobytes())
    return b"".join(parts)


def floats(*values: float) -> bytes:
    return np.array(values, dtype="<f4").tobytes()


PLY = b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
PLY += b"element edge %d\nproperty int vertex1\nproperty int vertex2\nend_header\n"
TFX_TEXT = b"version 2.0\nscale 1.0\nnumStrands %d\nis sorted 1\n%s"
LIES = {
    "hair header of billions": (".hair", hair(BILLIONS, BILLIONS), r"byte 128: expected 48000000000 bytes"),
    "hair strands without points": (".hair", hair(BILLIONS, 2, body=floats(*range(6))), r"byte 8: expected 8000000000"),
    "hair segments of billions": (".hair", hair(BILLIONS, 2, flags=3), r"byte 128: expected 8000000000 bytes"),
    "hair magic": (".hair", b"HARE" + hair(1, 2)[4:], r"byte 0: expected the letters HAIR"),
    "hair short header": (".hair", b"HAIR", r"byte 0: expected 128 bytes of header, found a file of 4 bytes"),
    "hair no points": (".hair", hair(1, 2, flags=0), r"byte 12"),
    "hair one-point strands": (".hair", hair(2, 2, segments=0, body=floats(*range(6))), r"byte 128: .*strand 0 with 1"),
    "hair zero length": (
        ".hair",
        hair(2, 4, body=floats(0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2)),
        r"byte 152: .*strand 1 whose 2 points are all the same",
    ),
    "hair nan": (".hair", hair(1, 2, body=floats(0, 0, 0, 1, float("nan"), 1)), r"byte 140: .*found 1 nan 1"),
    "hair no strands": (".hair", hair(0, 0), r"expected at least one strand"),
    "data billions": (".data", struct.pack("<i", 2_000_000_000), r"byte 4: expected 8000000000 bytes"),
    "data strand of billions": (".data", struct.pack("<ii", 1, 2_000_000_000), r"byte 8: expected 24000000000 bytes"),
    "data negative": (".data", struct.pack("<i", -1), r"byte 0: expected a strand count, found -1"),
    "data truncated": (".data", data(2, 2, 3)[:-4], r"byte 36: expected 36 bytes of 3 points of strand 1"),
    "data trailing": (".data", data(1, 2) + b"xxxx", r"byte 32: .*4 bytes more"),
    "data one point": (".data", data(2, 2, 1), r"byte 36: .*strand 1 with 1"),
    "data empty strand": (".data", data(2, 2, 0), r"byte 36: .*strand 1 with 0"),
    "data nan": (".data", data(1, 2)[:20] + NAN + data(1, 2)[24:], r"byte 20: expected finite coordinates"),
    "tfx billions": (".tfx", tfx(BILLIONS, 64), r"byte 160: expected 4096000000000 bytes"),
    "tfx one point": (
        ".tfx",
        tfx(1, 1, floats(0, 0, 0, 0)),
        r"byte 8: expected at least two points per strand, found 1",
    ),
    "tfx version": (".tfx", struct.pack("<f", 3.0) + tfx(1, 2)[4:], r"byte 0: expected TressFX version 4"),
    "tfx offset": (".tfx", tfx(1, 2)[:12] + struct.pack("<I", 8) + tfx(1, 2)[16:], r"byte 12"),
    "tfx text count": (".tfx", TFX_TEXT % (BILLIONS, b"strand 0 numVerts 2\n0 0 0\n1 1 1\n"), r"line 3 \(byte 22\)"),
    "tfx text verts": (
        ".tfx",
        TFX_TEXT % (1, b"strand 0 numVerts 4000000000\n0 0 0\n1 1 1\n"),
        r"line 5 \(byte 47\): expected 4000000000 lines",
    ),
    "tfx text nan": (".tfx", TFX_TEXT % (1, b"strand 0 numVerts 2\n0 0 0\n1 nan 1\n"), r"line 7 \(byte 73\)"),
    "tfx text word": (".tfx", TFX_TEXT % (1, b"strand 0 numVerts 2\n0 0 0\n1 b 1\n"), r"line 7 \(byte 75\): .*'b'"),
    "tfx text scale": (".tfx", b"version 2.0\nscale 2.0\nnumStrands 0\n", r"line 2 \(byte 12\)"),
    "tfx text one point": (".tfx", TFX_TEXT % (1, b"strand 0 numVerts 1\n0 0 0\n"), r"line 6 \(byte 67\)"),
    "obj mesh": (".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", r"found a mesh only"),
    "obj index": (".obj", b"v 0 0 0\nv 1 0 0\nl 1 4000000000\n", r"line 3 \(byte 16\): expected a vertex from 1 to 2"),
    "obj one point": (".obj", b"v 0 0 0\nv 1 0 0\nl 1\n", r"line 3 \(byte 16\): expected at least two points"),
    "obj nan": (".obj", b"v 0 0 0\nv nan 0 0\nl 1 2\n", r"line 2 \(byte 8\)"),
    "obj two coordinates": (".obj", b"v 0 0\nv 1 0 0\nl 1 2\n", r"line 1 \(byte 0\): expected three coordinates"),
    "obj word": (".obj", b"v 0 0 0\nv 1 1.2.3 0\nl 1 2\n", r"line 2 \(byte 12\): expected a number, found '1.2.3'"),
    "obj zero length": (".obj", b"v 0 0 0\nv 0 0 0\nl 1 2\n", r"line 1 \(byte 0\): .*strand 0 whose 2 points"),
    "ply billions": (".ply", PLY % (b"binary_little_endian", BILLIONS, 1), r"byte 181: expected 48000000000 bytes"),
    "ply text billions": (".ply", PLY % (b"ascii", BILLIONS, 1) + b"0 0 0\n", r"expected 4000000000 rows of vertex"),
    "ply edge": (".ply", PLY % (b"ascii", 2, 1) + b"0 0 0\n1 1 1\n0 2\n", r"line 13 .*from 0 to 1, found 0 and 2"),
    "ply points only": (
        ".ply",
        b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n",
        r"x, y, z",
    ),
    "ply no header": (".ply", b"play", r"byte 0\): expected a ply header"),
    "usd garbage": (".usd", b"garbage!" * 8, r"byte 0: expected a USD stage"),
    "usdc truncated": (".usdc", b"PXR-USDC" + bytes(8) + b"\xff" * 8, r"byte 16: .*table of contents"),
    "usda syntax": (".usda", b"#usda 1.0\ndef BasisCurves {{{", r"byte 0: expected a USD stage"),
    "usda no curves": (".usda", b'#usda 1.0\ndef Xform "a" {}\n', r"expected BasisCurves, found none"),
    "npz not a zip": (".npz", b"PK\x03\x04junk", r"byte 0: expected a groom \(an .npz archive"),
    "empty": (".hair", b"", r"it is empty \(stops at byte 0\)"),
}


@pytest.mark.parametrize("name", sorted(LIES))
def test_lies(name: str, tmp_path: Path):
    suffix, content, message = LIES[name]
    path = tmp_path / f"lie{suffix}"
    path.write_bytes(content)
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=message) as caught:
            read_groom(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20e6
    sentence = str(caught.value)
    assert sentence.startswith(str(path))
    assert "\n" not in sentence
    assert sentence.endswith(".")


def test_npz_whose_array_claims_more_than_it_holds(tmp_path: Path, uniform_groom: Groom):
    path = tmp_path / "a.npz"
    write_groom(path, uniform_groom)
    content = path.read_bytes()
    honest, lie = b"(30, 3), }          ", b"(4000000000, 3), }  "
    assert content.count(honest) == 1
    path.write_bytes(content.replace(honest, lie))
    tracemalloc.start()
    with pytest.raises(InputError, match=r"byte 0"):
        read_groom(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e6


def test_npz_bomb(tmp_path: Path):
    """A compressed array of zeros that would inflate a thousandfold is refused by its own claim."""
    path = tmp_path / "a.npz"
    np.savez_compressed(path, vertices=np.zeros((2_000_000, 3), np.float32), offsets=np.array([0, 2_000_000]))
    tracemalloc.start()
    with pytest.raises(InputError, match="of a sane size"):
        read_groom(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4e6


def test_npz_pickle_is_not_opened(tmp_path: Path):
    path = tmp_path / "a.npz"
    np.savez(path, vertices=np.array([{}], dtype=object), offsets=np.array([0, 1]))
    with pytest.raises(InputError, match="plain numbers"):
        read_groom(path)


@pytest.mark.parametrize("value", [-0.1, 1.5])
def test_parameters_outside_a_strand_are_refused(value: float, tmp_path: Path, uniform_groom: Groom):
    path = tmp_path / "a.npz"
    t = np.linspace(0, 1, 30, dtype=np.float32)
    t[7] = value
    np.savez(path, vertices=uniform_groom.vertices.numpy(), offsets=uniform_groom.offsets.numpy(), t=t)
    with pytest.raises(InputError, match=r"row 7: expected parameters t from 0 to 1"):
        read_groom(path)
