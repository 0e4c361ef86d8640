"""OBJ and PLY as other programs write them."""

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from trimesh.path import Path3D

from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom, write_groom
from neural_strands.grooms.polylines import join_chains

VERTICES = b"v 0 0 0\nv 0 1 0 1.0\nvt 0.5 0.5\nv 0 2 0\nvn 0 0 1\nv 5 0 0\nv 5 1 0\n"
EXPECTED = torch.tensor([[0.0, 0, 0], [0, 1, 0], [0, 2, 0], [5, 0, 0], [5, 1, 0]])
DIALECTS = {
    "polylines": b"l 1 2 3\nl 4 5\n",
    "texture indices": b"l 1/1 2/1 3/\nl 4/1 5\n",
    "negative indices": b"l -5 -4 -3\nl -2 -1\n",
    "loose edges": b"l 1 2\nl 2 3\nl 4 5\n",
    "continued lines": b"l 1 2 \\\n3\nl 4 5",
    "windows line ends": b"g hair\r\nl 1 2 3\r\nl 4 5\r\n",
    "comments and groups": b"# l 9 9\no hair\ns off\nusemtl line\n l 1 2 3\nl 4 5\n",
}


@pytest.mark.parametrize("name", sorted(DIALECTS))
def test_obj_dialects(name: str, tmp_path: Path):
    (tmp_path / "a.obj").write_bytes(VERTICES + DIALECTS[name])
    groom = read_groom(tmp_path / "a.obj")
    assert groom.sizes.tolist() == [3, 2]
    assert torch.equal(groom.vertices, EXPECTED)


def test_obj_negative_indices_count_from_their_line(tmp_path: Path):
    (tmp_path / "a.obj").write_bytes(b"v 0 0 0\nv 0 1 0\nl -2 -1\nv 5 0 0\nv 5 1 0\nl -2 -1\n")
    assert torch.equal(read_groom(tmp_path / "a.obj").vertices, EXPECTED[[0, 1, 3, 4]])


def ply_text(edges: str) -> str:
    header = "ply\nformat ascii 1.0\ncomment made elsewhere\nelement vertex 5\n"
    header += "property double x\nproperty double y\nproperty double z\nproperty uchar red\n"
    header += "element edge 3\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    return header + "0 0 0 9\n0 1 0 9\n0 2 0 9\n5 0 0 9\n5 1 0 9\n" + edges


def test_ply_text(tmp_path: Path):
    (tmp_path / "a.ply").write_text(ply_text("0 1\n1 2\n3 4\n"))
    groom = read_groom(tmp_path / "a.ply")
    assert groom.sizes.tolist() == [3, 2]
    assert torch.equal(groom.vertices, EXPECTED)


def test_ply_big_endian_with_other_properties(tmp_path: Path):
    header = b"ply\nformat binary_big_endian 1.0\nelement vertex 5\nproperty short quality\n"
    header += b"property float x\nproperty float y\nproperty float z\n"
    header += b"element edge 3\nproperty uint vertex1\nproperty uint vertex2\nend_header\n"
    table = np.zeros(5, dtype=[("quality", ">i2"), ("p", ">f4", 3)])
    table["p"] = EXPECTED.numpy()
    edges = np.array([[0, 1], [1, 2], [3, 4]], dtype=">u4")
    (tmp_path / "a.ply").write_bytes(header + table.tobytes() + edges.tobytes())
    groom = read_groom(tmp_path / "a.ply")
    assert groom.sizes.tolist() == [3, 2]
    assert torch.equal(groom.vertices, EXPECTED)


def test_others_read_our_ply(tmp_path: Path, ragged_groom: Groom):
    """trimesh skips the element of our own and finds the points."""
    write_groom(tmp_path / "a.ply", ragged_groom)
    cloud = trimesh.load(tmp_path / "a.ply")
    assert isinstance(cloud, Path3D)
    np.testing.assert_array_equal(np.asarray(cloud.vertices, dtype=np.float32), ragged_groom.vertices.numpy())


def test_our_obj_by_hand(tmp_path: Path, ragged_groom: Groom):
    """One line per strand, with indices counted from 1 in order: the format written by hand."""
    write_groom(tmp_path / "a.obj", ragged_groom)
    lines = [line.split()[1:] for line in (tmp_path / "a.obj").read_text().splitlines() if line.startswith("l ")]
    assert [len(line) for line in lines] == ragged_groom.sizes.tolist()
    assert [int(index) for line in lines for index in line] == list(range(1, 20))


def test_join_chains_by_hand():
    order, sizes = join_chains(np.array([7, 8, 8, 9, 1, 2, 3, 3, 4]), np.array([2, 2, 3, 2]))
    assert order.tolist() == [7, 8, 9, 1, 2, 3, 4]
    assert sizes.tolist() == [3, 4]
