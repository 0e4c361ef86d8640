"""Segments on disk: reading what was written is the identity, and another program reads the PLY."""

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.files import load_segments, save_segments


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


def test_trimesh_reads_the_ply(tmp_path: Path, segments: LineSegments):
    save_segments(tmp_path / "a.ply", segments)
    loaded = trimesh.load(tmp_path / "a.ply", process=False)
    assert np.allclose(loaded.vertices, segments.points.numpy(), atol=1e-6)
    data = loaded.metadata["_ply_raw"]
    assert data["vertex"]["data"]["segment_id"].ravel().tolist() == segments.segment_id.tolist()
    assert np.allclose(data["vertex"]["data"]["nx"].ravel(), segments.directions[:, 0].numpy())
    edges = np.stack([data["edge"]["data"][name].ravel() for name in ("vertex1", "vertex2")], axis=1)
    assert edges.tolist() == [[0, 1], [1, 2], [3, 4], [5, 6]]


def test_what_is_no_segments_file_is_refused(tmp_path: Path, segments: LineSegments):
    (tmp_path / "b.npz").write_bytes(b"no")
    with pytest.raises(InputError, match=r"b\.npz: expected line segments"):
        load_segments(tmp_path / "b.npz")
    with pytest.raises(InputError, match=r"ends in \.npz or \.ply"):
        save_segments(tmp_path / "a.obj", segments)
