"""Writing then reading is the identity; real files read as their makers describe them."""

from pathlib import Path

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.groom import ATTRIBUTES, Groom
from neural_strands.grooms.io import READERS, WRITERS, check_suffix, read_groom, write_groom

KEPT = {
    ".hair": {"width", "color"},
    ".data": set(),
    ".tfx": {"root_uv", "width", "color"},
    ".usd": set(ATTRIBUTES) - {"t"},
    ".usda": set(ATTRIBUTES) - {"t"},
    ".usdc": set(ATTRIBUTES) - {"t"},
    ".ply": set(ATTRIBUTES) - {"t"},
    ".obj": set(),
    ".npz": set(ATTRIBUTES),
}
TEXT_TFX_KEEPS = {"root_uv"}
REAL = {
    "straight_long/straight.hair": (10000, 160000, 77.203),
    "wavy_long/harolongo.data": (7905, 166005, 23.517),
    "sintel_bob/SintelHairOriginal-sintel_hair.16points.tfx": (11400, 182400, 0.1015),
    "sintel_guides/GEO-sintel_hair_emit.001-sintel_hair.tfx": (228, 7296, 10.437),
    "coil_swatch/70.obj": (98, 10589, 76.248),
}
"""Strands, points and median length as each file's SOURCE.txt states them."""


def assert_same(read: Groom, written: Groom, kept: set[str]) -> None:
    assert torch.equal(read.vertices, written.vertices)
    assert torch.equal(read.offsets, written.offsets)
    for name in ATTRIBUTES:
        value, expected = getattr(read, name), getattr(written, name)
        if name in kept:
            assert torch.equal(value, expected), name
        else:
            assert value is None, name


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_round_trip_uniform(suffix: str, tmp_path: Path, uniform_groom: Groom):
    write_groom(tmp_path / f"a{suffix}", uniform_groom)
    assert_same(read_groom(tmp_path / f"a{suffix}"), uniform_groom, KEPT[suffix])


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_round_trip_ragged(suffix: str, tmp_path: Path, ragged_groom: Groom):
    kept = TEXT_TFX_KEEPS if suffix == ".tfx" else KEPT[suffix]
    write_groom(tmp_path / f"a{suffix}", ragged_groom)
    assert_same(read_groom(tmp_path / f"a{suffix}"), ragged_groom, kept)


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_round_trip_bare_and_extreme(suffix: str, tmp_path: Path):
    """Denormals, negative zero and large values survive text as well as binary."""
    vertices = torch.tensor([[1e-42, -0.0, 9e8], [1 / 3, -1e-38, 16777217.0], [0.1, 0.2, 0.3]])
    groom = Groom(vertices, torch.tensor([0, 3]))
    write_groom(tmp_path / f"a{suffix}", groom)
    assert_same(read_groom(tmp_path / f"a{suffix}"), groom, set())


def test_every_suffix_reads_and_writes():
    assert set(READERS) == set(WRITERS)


@pytest.mark.parametrize("name", sorted(REAL))
def test_real_files(name: str, shared_data: Path):
    strands, points, median = REAL[name]
    groom = read_groom(shared_data / "grooms" / name)
    assert len(groom) == strands
    assert len(groom.vertices) == points
    assert float(groom.lengths().quantile(0.5)) == pytest.approx(median, abs=6e-4)


def test_real_colour(shared_data: Path):
    """The .hair file repeats its single colour for every point (SOURCE.txt)."""
    groom = read_groom(shared_data / "grooms/straight_long/straight.hair")
    assert groom.color is not None
    expected = torch.tensor([1.0, 0.9254902601242065, 0.5686274766921997])
    assert (groom.color - expected).abs().max() < 1e-6


def test_unknown_suffix_names_those_there_are(tmp_path: Path):
    (tmp_path / "a.abc").write_bytes(b"x")
    with pytest.raises(InputError, match=r"a\.abc: expected a groom with one of \.hair, .*found \.abc; choose one"):
        read_groom(tmp_path / "a.abc")
    with pytest.raises(InputError, match="no suffix"):
        check_suffix(tmp_path / "a")


def test_missing_file_and_folder(tmp_path: Path):
    with pytest.raises(InputError, match="found nothing there"):
        read_groom(tmp_path / "none.hair")
    with pytest.raises(InputError, match="found a folder there; name a file in it"):
        read_groom(tmp_path)


@pytest.mark.parametrize("suffix", sorted(READERS))
def test_writing_what_no_reader_takes_leaves_no_file(suffix: str, tmp_path: Path, uniform_groom: Groom):
    uniform_groom.vertices[7, 1] = float("nan")
    with pytest.raises(InputError, match=r"row 7 of vertices"):
        write_groom(tmp_path / f"a{suffix}", uniform_groom)
    assert not list(tmp_path.iterdir())


def test_upper_case_suffix(tmp_path: Path, uniform_groom: Groom):
    write_groom(tmp_path / "A.HAIR", uniform_groom)
    assert len(read_groom(tmp_path / "A.HAIR")) == 5
