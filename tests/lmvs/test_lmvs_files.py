"""Segments on disk: reading what was written is the identity, and another program reads the PLY."""

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from damage import EDIT, damage, fuzz, read_or_refuse
from hypothesis import given
from hypothesis import strategies as st
from trimesh.path import Path3D

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.files import SegmentsSource, load_segments, load_segments_source, save_segments


@pytest.fixture
def segments(generator: torch.Generator) -> LineSegments:
    directions = torch.nn.functional.normalize(torch.randn(7, 3, generator=generator), dim=-1)
    points = torch.randn(7, 3, generator=generator)
    return LineSegments(points, directions, torch.rand(7, generator=generator), torch.tensor([0, 0, 0, 1, 1, 2, 2]))


def test_npz_comes_back(tmp_path: Path, segments: LineSegments):
    save_segments(tmp_path / "a.npz", segments)
    again = load_segments(tmp_path / "a.npz")
    for name in ("points", "directions", "confidence", "segment_id"):
        assert torch.equal(getattr(again, name), getattr(segments, name))


def test_npz_says_what_its_segments_were_made_from(tmp_path: Path, segments: LineSegments):
    source = SegmentsSource(("000.png", "left/ä b.png"), {"seed": 3, "stereo": {"scales": [1.0, 2.0]}, "size": None})
    save_segments(tmp_path / "a.npz", segments, source)
    assert load_segments_source(tmp_path / "a.npz") == source
    assert torch.equal(load_segments(tmp_path / "a.npz").points, segments.points)
    save_segments(tmp_path / "b.npz", segments)
    assert load_segments_source(tmp_path / "b.npz") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no", "source: expected the views of line segments as JSON"),
        ('{"settings": {}}', "source: expected a value under 'views'"),
        ('{"views": [5], "settings": {}}', r"source: views\[0\]: expected a text"),
        ('{"views": [], "settings": 5}', "source: settings: expected an object"),
        ("[" * 9999, "nested too deeply"),
    ],
)
def test_a_damaged_source_is_one_sentence(tmp_path: Path, segments: LineSegments, text: str, message: str):
    save_segments(tmp_path / "a.npz", segments)
    arrays = dict(np.load(tmp_path / "a.npz"))
    np.savez(tmp_path / "a.npz", **arrays, source=np.frombuffer(text.encode(), np.uint8))
    with pytest.raises(InputError, match=message) as caught:
        load_segments_source(tmp_path / "a.npz")
    assert str(caught.value).endswith("; run lmvs again.")


def test_trimesh_reads_the_ply(tmp_path: Path, segments: LineSegments):
    save_segments(tmp_path / "a.ply", segments)
    loaded = trimesh.load(tmp_path / "a.ply", process=False)
    assert isinstance(loaded, Path3D)
    assert np.allclose(loaded.vertices, segments.points.numpy(), atol=1e-6)
    data = loaded.metadata["_ply_raw"]
    assert data["vertex"]["data"]["segment_id"].ravel().tolist() == segments.segment_id.tolist()
    assert np.allclose(data["vertex"]["data"]["nx"].ravel(), segments.directions[:, 0].numpy())
    edges = np.stack([data["edge"]["data"][name].ravel() for name in ("vertex1", "vertex2")], axis=1)
    assert edges.tolist() == [[0, 1], [1, 2], [3, 4], [5, 6]]


WRONG = {
    "missing": ({"points": None}, "an array points"),
    "shape": ({"points": np.zeros((7, 2))}, r"points of floats in shape \(point = 7, 3\)"),
    "length": ({"confidence": np.ones(6)}, r"confidence of floats in shape \(point = 7\)"),
    "type": ({"segment_id": np.zeros(7)}, "segment_id of whole numbers"),
    "nan": ({"points": np.full((7, 3), np.nan)}, r"finite numbers in points, found nan at \[0, 0\]"),
    "infinite": ({"directions": np.full((7, 3), np.inf)}, "finite numbers in directions"),
    "no unit": ({"directions": np.full((7, 3), 3.0)}, r"directions of length 1, found \[3.0, 3.0, 3.0\] at point 0"),
    "no share": ({"confidence": np.linspace(0, 2, 7)}, "confidence from 0 to 1, found 1.3333.* at point 4"),
    "falling": ({"segment_id": np.array([0, 0, 1, 1, 0, 2, 2])}, "counts segments up from 0, found 0 at point 4"),
    "far": ({"segment_id": np.array([0, 0, 1, 1, 1, 10**12, 10**12])}, "counts segments up from 0"),
    "negative": ({"segment_id": np.full(7, -1)}, "counts segments up from 0"),
    "pickled": ({"points": np.full((7, 3), None)}, "plain numbers"),
}


@pytest.mark.parametrize("name", sorted(WRONG))
def test_wrong_arrays_are_one_sentence(tmp_path: Path, segments: LineSegments, name: str):
    changes, message = WRONG[name]
    arrays = {key: getattr(segments, key).numpy() for key in ("points", "directions", "confidence", "segment_id")}
    np.savez(tmp_path / "a.npz", **{key: value for key, value in (arrays | changes).items() if value is not None})
    with pytest.raises(InputError, match=message) as caught:
        load_segments(tmp_path / "a.npz")
    assert str(caught.value).endswith("; run lmvs again.")


def test_no_segments_at_all(tmp_path: Path, segments: LineSegments):
    none = segments.select(torch.zeros(7, dtype=torch.bool))
    save_segments(tmp_path / "a.npz", none)
    assert len(load_segments(tmp_path / "a.npz")) == 0


@fuzz(200)
@given(edits=st.lists(EDIT, min_size=1, max_size=4))
def test_damage(tmp_path: Path, edits: list):
    count = 40
    up = torch.tensor([0.0, 1.0, 0.0]).expand(count, 3)
    path = tmp_path / "a.npz"
    save_segments(path, LineSegments(torch.zeros(count, 3), up, torch.ones(count), torch.arange(count)))
    read_or_refuse(path, damage(path.read_bytes(), edits), load_segments)


def test_what_is_no_segments_file_is_refused(tmp_path: Path, segments: LineSegments):
    (tmp_path / "b.npz").write_bytes(b"no")
    with pytest.raises(InputError, match=r"b\.npz: byte 0: expected line segments"):
        load_segments(tmp_path / "b.npz")
    with pytest.raises(InputError, match=r"ends in \.npz or \.ply"):
        save_segments(tmp_path / "a.obj", segments)
