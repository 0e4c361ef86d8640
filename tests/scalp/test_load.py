"""Heads from files: every way of naming the scalp, units, order, refusals; the mannequin itself."""

import gzip
import json
import zlib

import cv2
import numpy as np
import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.mesh import Mesh, face_areas
from neural_strands.scalp.hairline import measure_head, scalp_faces
from neural_strands.scalp.load import load_head
from neural_strands.scalp.mannequin import mannequin
from neural_strands.scalp.mesh_file import read_mesh_file
from neural_strands.scalp.overlap import overlapping_faces


def write_obj(path, vertices, polygons, uv=None):
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"vt {u} {v}" for u, v in uv or []]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}" if uv else str(i + 1) for i in polygon) for polygon in polygons]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def quads(tmp_path):
    """Two quads and a triangle in a row; uv = (x / 3, z)."""
    vertices = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 0, 0), (2, 0, 1), (2, 0, 0), (3, 0, 0)]
    uv = [(x / 3, float(z)) for x, _, z in vertices]
    return write_obj(tmp_path / "q.obj", vertices, [(0, 1, 2, 3), (3, 2, 4, 5), (5, 4, 6)], uv)


def chart(path, content):
    path.write_bytes(gzip.compress(json.dumps(content).encode()))
    return path


def test_chart_by_loop_is_triangulated_with_its_uv(quads, tmp_path):
    # Loops 4 to 7 are the second quad's corners, in the order of its line.
    given = {"1": {"4": [0.1, 0.1], "5": [0.1, 0.9], "6": [0.9, 0.9], "7": [0.9, 0.1]}}
    head = load_head(quads, chart(tmp_path / "c.json.gz", given), scale=0.1)
    assert head.scalp_faces.tolist() == [2, 3]
    assert head.mesh.faces[head.scalp_faces].tolist() == [[3, 2, 4], [3, 4, 5]]
    torch.testing.assert_close(head.scalp_uv[0], torch.tensor([[0.1, 0.1], [0.1, 0.9], [0.9, 0.9]]))
    torch.testing.assert_close(head.scalp_uv[1], torch.tensor([[0.1, 0.1], [0.9, 0.9], [0.9, 0.1]]))
    assert head.scalp_area == pytest.approx(0.01)


def test_overlapping_chart_is_refused_with_its_faces(quads, tmp_path):
    square = [[0.1, 0.1], [0.1, 0.9], [0.9, 0.9], [0.9, 0.1]]
    given = {str(f): {str(4 * f + k): uv for k, uv in enumerate(square)} for f in (0, 1)}
    with pytest.raises(InputError, match=r"c\.json\.gz: expected a scalp chart without overlaps.*0 and 1"):
        load_head(quads, chart(tmp_path / "c.json.gz", given), scale=1.0)


@pytest.mark.parametrize(
    ("content", "triangles"),
    [([1], [2, 3]), ({"faces": [0, 2]}, [0, 1, 4]), ({"vertices": [4, 5, 6]}, [4])],
)
def test_lists_count_polygons_and_vertices(quads, tmp_path, content, triangles):
    scalp = tmp_path / "s.json"
    scalp.write_text(json.dumps(content))
    head = load_head(quads, scalp, scale=1.0)
    assert head.scalp_faces.tolist() == triangles
    assert len(overlapping_faces(head.scalp_uv)) == 0


def test_painted_mask(quads, tmp_path):
    image = np.zeros((30, 30), np.uint8)
    image[:, 20:] = 255  # u > 2/3: the last triangle
    assert cv2.imwrite(str(tmp_path / "m.png"), image)
    assert load_head(quads, tmp_path / "m.png", scale=1.0).scalp_faces.tolist() == [4]


def test_a_huge_or_damaged_mask_is_one_sentence_before_it_is_decoded(quads, tmp_path):
    def chunk(kind, data):
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    def png(side, pixels):
        header = chunk(b"IHDR", 2 * side.to_bytes(4, "big") + bytes([8, 0, 0, 0, 0]))
        return b"\x89PNG\r\n\x1a\n" + header + pixels + chunk(b"IEND", b"")

    mask = tmp_path / "mask.png"
    mask.write_bytes(png(13_000, chunk(b"IDAT", zlib.compress(b"\0" * 100))))
    with pytest.raises(InputError, match=r"mask\.png: expected an image of at most .* found 13000 x 13000"):
        load_head(quads, mask)
    mask.write_bytes(png(30, b""))
    with pytest.raises(InputError, match=r"mask\.png: expected an image that can be decoded, found a damaged one"):
        load_head(quads, mask)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("[99]", r"s\.json: \[0\]: expected a whole number from 0 to 2, found 99"),
        ('{"vertices": [-1]}', r"vertices\[0\]: expected a whole number from 0 to 6, found -1"),
        ('{"1": {"4": [0, 0]}}', r"uv for every loop.*loop 5"),
        ('{"1": {"4": [0, 0], "5": [0, 1], "6": [2, 1], "7": [1, 0]}}', r"uv in \[0, 1\], found face 1"),
        ('"x"', r"face number -> loop number"),
        ("{", r"as JSON, found"),
        ("[]", r"scalp with an area, found none"),
        ("[" + "9" * 31 + "]", r"whole number from 0 to 2, found 9{31}"),
        ("[true]", r"whole number from 0 to 2, found True"),
        ("[0.5]", r"whole number from 0 to 2, found 0\.5"),
        ("[" * 100_000, r"nested too deeply"),
        ('{"1": {"4": [1' + "0" * 400 + ", 0]}}", r"finite numbers in lists of size 2"),
        ('{"1": {"x": [0, 0]}}', r"names that are numbers.*, found 'x'"),
        ('{"3": {}}', r"names that are numbers from 0 to 2, found '3'"),
        ('{"1" : 5}', r"an object in braces, found 5"),
        ('{"1": {"4": [NaN, 0], "5": [0, 1], "6": [1, 1], "7": [1, 0]}}', r"NaN, which is no number"),
    ],
)
def test_bad_scalps_are_refused(quads, tmp_path, content, message):
    scalp = tmp_path / "s.json"
    scalp.write_text(content)
    with pytest.raises(InputError, match=message):
        load_head(quads, scalp, scale=1.0)


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found none"),
        ("v 0 0 0\nv 1 0 0\nf 1 2 9\n", "found 9"),
        ("v 0 0 x\n", "line 1"),
        ("v 0 0 0\nf 1 1\n", "fewer than three"),
        ("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "finite"),
        ("v 0 0 0\nf a b c\n", "existing vertices"),
        ("v 0 0 0\nf 1 1 1\n", "without any area"),
        ("v 1\nf 1 1 1\n", "line 1: expected three finite numbers, found 'v 1'"),
        (TRIANGLE + "f 1 2 " + "9" * 20 + "\n", "line 4: expected a face of existing vertices"),
        (TRIANGLE + "f 1 2 -4\n", "line 4: expected a face of existing vertices"),
        (TRIANGLE + "f 1 2 0\n", "line 4: expected a face of existing vertices"),
        (TRIANGLE + "vt nan 0\nf 1/1 2/1 3/1\n", "finite texture coordinates"),
        (TRIANGLE + "vt 0 0\nf 1/1 2/2 3/1\n", "texture points 1 to 1, found 2"),
        (TRIANGLE + "vt x\n", "line 4: expected two numbers"),
        ("v 1e300 0 0\n" + TRIANGLE + "f 1 2 3\n", "more than 1e9"),
        (TRIANGLE + "g helper-hair\nf 1 2 3\n", "found none"),
        (TRIANGLE + "f 1 2 " + "x" * 10_000 + "\n", r"found 'f 1 2 x+\.\.\.x*'; export"),
    ],
)
def test_bad_meshes_are_refused(tmp_path, text, message):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        load_head(path)


def test_negative_numbers_count_back_from_the_line(tmp_path):
    path = tmp_path / "m.obj"
    path.write_text(TRIANGLE + "f -3 -2 -1\nv 0 0 5\nf -1 1 2\n")
    assert read_mesh_file(path).mesh.faces.tolist() == [[0, 1, 2], [3, 0, 1]]


@pytest.mark.parametrize("name", ["bad.ply", "bad.stl", "bad.glb"])
@pytest.mark.parametrize("content", [b"", b"\x00" * 90, b"ply\nformat ascii 1.0\nelement vertex 3\n", b"glTF" * 20])
def test_garbage_in_other_formats_is_one_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=rf"{name}: expected a .*export") as caught:
        read_mesh_file(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_other_suffixes_and_unreadable_files_are_refused(quads, tmp_path, monkeypatch):
    (tmp_path / "m.dae").write_text("<xml/>")
    with pytest.raises(InputError, match=r"\.obj, \.ply, \.stl, \.glb, found '\.dae'"):
        read_mesh_file(tmp_path / "m.dae")
    (tmp_path / "s.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"s\.png: expected an image such as PNG or JPEG, found something else"):
        load_head(quads, tmp_path / "s.png")

    def refused(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(quads), "open", refused)
    for path in (quads, tmp_path / "m.ply"):
        path.touch()
        with pytest.raises(InputError, match="cannot be read \\(Permission denied\\)"):
            read_mesh_file(path)


def test_absent_files_are_refused(quads, tmp_path):
    with pytest.raises(InputError, match="check the path"):
        load_head(tmp_path / "none.obj")
    with pytest.raises(InputError, match="check the path"):
        load_head(quads, tmp_path / "none.json")


@pytest.mark.parametrize("unit", [1.0, 0.1, 0.01, 0.001, 0.0254])
def test_unit_is_guessed_from_the_width(tmp_path, unit):
    mesh = mannequin().mesh
    path = write_obj(tmp_path / "m.obj", (mesh.vertices / unit).tolist(), mesh.faces.tolist())
    head = load_head(path)
    torch.testing.assert_close(head.mesh.vertices, mesh.vertices, atol=1e-4, rtol=0)
    assert torch.equal(head.mesh.faces, mesh.faces)
    assert head.scalp_area == pytest.approx(mannequin().scalp_area, rel=0.02)


def test_mannequin_is_watertight_symmetric_and_head_sized():
    head = mannequin()
    faces = head.mesh.faces
    edges = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    size = len(head.mesh.vertices)
    forward, backward = edges[:, 0] * size + edges[:, 1], edges[:, 1] * size + edges[:, 0]
    # Every directed edge occurs once, and so does its opposite: closed, manifold, and consistently oriented.
    assert len(forward.unique()) == len(forward)
    assert torch.equal(forward.sort().values, backward.sort().values)
    corners = head.mesh.corners().double()
    volume = (corners[:, 0] * torch.linalg.cross(corners[:, 1], corners[:, 2])).sum() / 6
    assert 0.005 < volume < 0.012
    assert 3000 < len(faces) < 25_000
    assert 0.14 < measure_head(head.mesh.vertices).width < 0.17
    assert 0.05 < head.scalp_area < 0.08
    assert head.mesh.vertices.mean(dim=0)[0].abs() < 1e-3
    # Ears stick out at the sides and are not scalp.
    assert head.scalp_mesh.corners()[..., 0].abs().max() < 0.081


@pytest.mark.parametrize("name", ["sintel_bob", "straight_long"])
def test_capture_heads_keep_their_faces(shared_data, name):
    folder = shared_data / "captures" / name
    head = load_head(folder / "head.obj", folder / "scalp_faces.json")
    assert head.scalp_faces.tolist() == sorted(json.loads((folder / "scalp_faces.json").read_text()))
    strands = np.load(folder / "ground_truth.npz")
    roots = torch.from_numpy(strands["strands"][:, 0].astype(np.float32) * float(strands["unit"]))
    middle = head.scalp_mesh.corners().mean(dim=(0, 1))
    assert (roots.mean(dim=0) - middle).norm() < 0.06


def test_makehuman_chart(shared_data):
    folder = shared_data / "heads" / "makehuman"
    head = load_head(folder / "base.obj", folder / "scalp_solid.json.gz")
    assert len(head.scalp_faces) == 1040
    assert head.scalp_area == pytest.approx(0.0746, abs=0.001)
    # The scalp found without the chart covers nearly the same skin.
    found = scalp_faces(head.mesh)
    areas = face_areas(head.mesh)
    both = found[torch.isin(found, head.scalp_faces)]
    either = torch.cat([found, head.scalp_faces]).unique()
    assert areas[both].sum() / areas[either].sum() > 0.75


def test_ict_scalp_is_found(shared_data):
    head = load_head(shared_data / "heads" / "ict" / "generic_neutral_mesh.obj")
    assert 0.055 < head.scalp_area < 0.08
    assert len(overlapping_faces(head.scalp_uv)) == 0


def test_other_formats_keep_their_order(tmp_path):
    import trimesh

    mesh = mannequin().mesh
    path = tmp_path / "m.ply"
    trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False).export(path)
    read = read_mesh_file(path).mesh
    assert torch.equal(read.faces, mesh.faces)
    torch.testing.assert_close(read.vertices, mesh.vertices)


@pytest.mark.parametrize("kind", ["ascii 1.0", "binary_little_endian 1.0"])
def test_polygons_of_a_ply_are_counted_as_in_the_file(quads, tmp_path, kind):
    """Two quads, split as trimesh splits them: both first halves, then both second halves."""
    table = read_mesh_file(quads).mesh
    polygons = np.array([[0, 1, 2, 3], [3, 2, 4, 5]], dtype="<i4")
    header = f"ply\nformat {kind}\nelement vertex 7\n" + "".join(f"property float {name}\n" for name in "xyzst")
    header += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    vertices = np.concatenate([table.vertices, table.vertices[:, [0, 2]] / 3], axis=1).astype("<f4")
    if kind.startswith("ascii"):
        rows = [" ".join(map(str, row)) for row in vertices.tolist()]
        body = ("\n".join(rows + [f"4 {a} {b} {c} {d}" for a, b, c, d in polygons.tolist()]) + "\n").encode()
    else:
        body = vertices.tobytes() + b"".join(b"\x04" + row.tobytes() for row in polygons)
    (tmp_path / "q.ply").write_bytes(header.encode() + body)
    read = read_mesh_file(tmp_path / "q.ply")
    assert read.polygon.tolist() == [0, 0, 1, 1]
    assert read.mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 4], [3, 4, 5]]
    torch.testing.assert_close(read.mesh.corner_uv, torch.from_numpy(vertices[:, 3:])[read.mesh.faces])


def test_an_stl_is_welded_to_a_surface(tmp_path):
    import trimesh

    mesh = mannequin().mesh
    path = tmp_path / "m.stl"
    trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False).export(path)
    read = read_mesh_file(path).mesh
    assert len(read.vertices) == len(mesh.vertices.unique(dim=0))
    assert torch.equal(read.corners(), mesh.corners())
    assert load_head(path).scalp_area == pytest.approx(mannequin().scalp_area, rel=1e-4)


def test_a_scale_that_is_no_length_is_refused(quads):
    for scale in (-1.0, 0.0, float("inf"), float("nan")):
        with pytest.raises(InputError, match="more than 0 metres per unit"):
            load_head(quads, scale=scale)


def test_a_lone_triangle_is_still_charted(tmp_path):
    flat = Mesh(torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 0, -1]]), torch.tensor([[0, 1, 2]]))
    path = write_obj(tmp_path / "flat.obj", flat.vertices.tolist(), flat.faces.tolist())
    head = load_head(path)
    assert len(head.scalp_faces) == 1
