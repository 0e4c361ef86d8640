"""Export formats: guides and motion in USD, lines in .glb, Alembic through Blender."""

import importlib
import json
import os
import struct
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from neural_strands.foundation.errors import InputError
from neural_strands.grooms.groom import Groom
from neural_strands.grooms.io import read_groom
from neural_strands.grooms.motion import Motion
from neural_strands.grooms.scenes.alembic import Blender
from neural_strands.grooms.scenes.scene import Scene, check_scene_path, write_scene

REAL_BLENDER = "NEURAL_STRANDS_BLENDER"
"""Environment variable: a Python that has bpy."""
LOOK = """
import json, sys
import bpy
import numpy as np

bpy.ops.wm.read_factory_settings(use_empty=True)
# Alembic keeps time in seconds.
bpy.context.scene.render.fps = 12
path = sys.argv[-1]
(bpy.ops.wm.alembic_import if path.endswith(".abc") else bpy.ops.wm.usd_import)(filepath=path)
found = {}
for shown in bpy.data.objects:
    if shown.type != "CURVES":
        continue
    frames = []
    for frame in (0, 2):
        bpy.context.scene.frame_set(frame)
        curves = shown.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        points = np.zeros(3 * len(curves.points), np.float32)
        curves.attributes["position"].data.foreach_get("vector", points)
        matrix = np.array(shown.matrix_world)
        frames.append((points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]).tolist())
    radius = np.zeros(len(curves.points), np.float32)
    if "radius" in curves.attributes:
        curves.attributes["radius"].data.foreach_get("value", radius)
    colours = np.zeros(4 * len(curves.curves), np.float32)
    if "displayColor" in curves.attributes:
        curves.attributes["displayColor"].data.foreach_get("color", colours)
    sizes = [curve.points_length for curve in curves.curves]
    names = [attribute.name for attribute in curves.attributes]
    found[shown.name] = {"frames": frames, "sizes": sizes, "radius": radius.tolist(), "names": names}
    found[shown.name]["colours"] = colours.reshape(-1, 4)[:, :3].tolist()
print("found " + json.dumps(found))
"""


@pytest.fixture
def scene(generator) -> Scene:
    sizes = torch.tensor([5, 3, 4])
    vertices = torch.randn(12, 3, generator=generator) * 0.1
    strands = Groom(
        vertices,
        torch.cat([torch.zeros(1, dtype=torch.int64), sizes.cumsum(0)]),
        root_uv=torch.rand(3, 2, generator=generator),
        root_normal=torch.nn.functional.normalize(torch.randn(3, 3, generator=generator), dim=1),
        width=torch.rand(12, generator=generator) * 1e-4,
        color=torch.rand(3, 3, generator=generator),
        unseen=torch.tensor([0.0, 0.75, 1.0]),
    )
    guides = Groom(vertices[:5], torch.tensor([0, 5]))
    return Scene(strands, guides, Motion(12.0, 3, lambda frame: vertices + 0.01 * frame))


@pytest.mark.parametrize("suffix", [".usd", ".usda"])
def test_usd_holds_guides_and_a_sample_per_frame(scene, tmp_path, suffix):
    path = tmp_path / f"hair{suffix}"
    write_scene(path, scene, Blender())
    usd, geometry = importlib.import_module("pxr.Usd"), importlib.import_module("pxr.UsdGeom")
    stage = usd.Stage.Open(str(path))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (0, 2, 12)
    points = geometry.BasisCurves(stage.GetPrimAtPath("/hair/strands")).GetPointsAttr()
    for frame in range(3):
        assert np.allclose(np.array(points.Get(frame)), scene.strands.vertices + 0.01 * frame, atol=1e-6)
    guides = geometry.BasisCurves(stage.GetPrimAtPath("/hair/guides"))
    assert guides.GetPurposeAttr().Get() == "guide"
    # When it is read as a groom, the guides are not added to the strands that they represent.
    again = read_groom(path)
    assert torch.equal(again.offsets, scene.strands.offsets)
    assert torch.allclose(again.vertices, scene.strands.vertices, atol=1e-6)
    assert again.color is not None


def test_usdchecker_finds_nothing_wrong(scene, tmp_path):
    write_scene(tmp_path / "hair.usd", scene, Blender())
    usd, checks = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdValidation")
    # What the program usdchecker runs.
    validators = checks.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = checks.ValidationContext(validators).Validate(usd.Stage.Open(str(tmp_path / "hair.usd")))
    assert [error.GetErrorAsString() for error in errors] == []


def test_glb_is_read_by_another_library(scene, tmp_path):
    path = tmp_path / "hair.glb"
    write_scene(path, scene, Blender())
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack_from("<I", data, 12)[0]
    document = json.loads(data[20 : 20 + size])
    assert document["meshes"][0]["primitives"][0]["mode"] == 1
    read = trimesh.load_scene(path)
    assert np.allclose(read.bounds, [scene.strands.vertices.amin(0), scene.strands.vertices.amax(0)], atol=1e-6)
    (lines,) = read.geometry.values()
    shares = np.asarray(lines.vertex_attributes["_UNSEEN"]).ravel()
    assert shares.tolist() == 5 * [0.0] + 3 * [0.75] + 4 * [1.0]
    binary = data[28 + size :]
    views, accessors = document["bufferViews"], document["accessors"]
    indices = np.frombuffer(binary, np.uint32, accessors[0]["count"], views[0]["byteOffset"]).reshape(-1, 2)
    assert indices.tolist() == [[0, 1], [1, 2], [2, 3], [3, 4], [5, 6], [6, 7], [8, 9], [9, 10], [10, 11]]
    colours = np.frombuffer(binary, np.uint16, 4 * 12, views[2]["byteOffset"]).reshape(12, 4) / 65535
    assert scene.strands.color is not None
    assert np.allclose(colours[[0, 4, 5, 11], :3], scene.strands.color[[0, 0, 1, 2]], atol=1e-4)
    assert (colours[:, 3] == 1).all()


def test_glb_of_bare_strands_has_only_positions(scene, tmp_path):
    write_scene(tmp_path / "hair.glb", Scene(replace(scene.strands, color=None, unseen=None)), Blender())
    (lines,) = trimesh.load_scene(tmp_path / "hair.glb").geometry.values()
    assert np.allclose(lines.vertices, scene.strands.vertices, atol=1e-6)
    assert "_UNSEEN" not in lines.vertex_attributes


@pytest.mark.parametrize("suffix", [".hair", ".data", ".tfx", ".ply", ".obj", ".npz"])
def test_grooms_read_back_equal(scene, tmp_path, suffix):
    path = tmp_path / f"hair{suffix}"
    write_scene(path, scene, Blender())
    again = read_groom(path)
    assert torch.equal(again.offsets, scene.strands.offsets)
    assert torch.allclose(again.vertices, scene.strands.vertices, atol=1e-5)


def test_alembic_holds_what_unreal_reads(scene, tmp_path):
    pytest.importorskip("alembic3d")
    abc, geometry = importlib.import_module("alembic3d.Abc"), importlib.import_module("alembic3d.AbcGeom")
    path = tmp_path / "hair.abc"
    write_scene(path, scene, Blender())
    archive = abc.IArchive(str(path))
    top = archive.getTop()
    for name, groom, guide in (("strands", scene.strands, 0), ("guides", scene.guides, 1)):
        curves = geometry.ICurves(top, name)
        schema = curves.getSchema()
        assert schema.getNumSamples() == (3 if name == "strands" else 1)
        for frame in range(schema.getNumSamples()):
            # A time, in seconds.
            sample = schema.getValue(abc.ISampleSelector(frame / 12))
            points = [list(point) for point in sample.getPositions()]
            assert np.allclose(points, groom.vertices + 0.01 * frame, atol=1e-6)
            assert list(sample.getCurvesNumVertices()) == groom.sizes.tolist()
        held = schema.getArbGeomParams()

        def values(kind: str, attribute: str, held: object = held) -> list:
            read = getattr(geometry, f"I{kind}GeomParam")(held, attribute)
            return list(read.getExpandedValue().getVals())

        assert values("Int16", "groom_guide") == [guide]
        assert values("Int32", "groom_group_id") == [0]
        assert [*values("Int16", "groom_version_major"), *values("Int16", "groom_version_minor")] == [1, 5]
        assert values("Int32", "groom_id") == list(range(len(groom)))
        if groom.root_uv is not None:
            assert np.allclose([list(uv) for uv in values("V2f", "groom_root_uv")], groom.root_uv)
            assert np.allclose(values("Float", "groom_width"), groom.width)
            assert np.allclose([list(colour) for colour in values("C3f", "groom_color")], groom.color)
            assert values("Float", "unseen") == [0.0, 0.75, 1.0]
            parameter = geometry.IFloatGeomParam(held, "unseen")
            assert parameter.getScope() == geometry.GeometryScope.kUniformScope
        else:
            assert "unseen" not in [held.getPropertyHeader(k).getName() for k in range(held.getNumProperties())]
    assert geometry.ICurves(top, "strands").getSchema().getTimeSampling().getSampleTime(2) == pytest.approx(2 / 12)


@pytest.mark.slow
@pytest.mark.parametrize("written_by", ["alembic3d", "blender"])
@pytest.mark.parametrize("suffix", [".abc", ".usd"])
def test_blender_opens_what_is_written(scene, tmp_path, suffix, written_by):
    """Both are upright in Blender, where z is up: (x, y, z) is at (x, -z, y)."""
    python = os.environ.get(REAL_BLENDER)
    if python is None:
        pytest.skip(f"{REAL_BLENDER} names no Python with bpy")
    if written_by == "alembic3d":
        pytest.importorskip("alembic3d")
    path = tmp_path / f"hair{suffix}"
    write_scene(path, scene, Blender(Path(python) if written_by == "blender" else None))
    (tmp_path / "look.py").write_text(LOOK)
    done = subprocess.run([python, tmp_path / "look.py", path], capture_output=True, text=True, check=True)
    line = next(line for line in done.stdout.splitlines() if line.startswith("found "))
    found = json.loads(line.removeprefix("found "))
    strands = found["strands"]
    assert strands["sizes"] == [5, 3, 4]
    for shown, frame in zip(strands["frames"], (0, 2), strict=True):
        x, y, z = (scene.strands.vertices + 0.01 * frame).unbind(dim=1)
        assert np.allclose(shown, torch.stack([x, -z, y], dim=1), atol=1e-5)
    assert scene.strands.width is not None
    assert np.allclose(strands["radius"], scene.strands.width / 2, atol=1e-7)
    if suffix == ".usd":
        assert {"displayColor", "st", "rootNormal"} <= set(strands["names"])
        assert np.allclose(strands["colours"], scene.strands.color, atol=1e-6)
    else:
        assert found["guides"]["sizes"] == [5]


def test_refusals(scene, tmp_path, monkeypatch):
    with pytest.raises(InputError, match=r"expected a groom with one of .usd, .* found .gltf; choose one"):
        check_scene_path(tmp_path / "hair.gltf")
    with pytest.raises(InputError, match=r"expected a format that holds motion with one of .* found .ply"):
        check_scene_path(tmp_path / "hair.ply", moves=True)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"expected the module alembic3d or Blender's module bpy, found neither"):
        write_scene(tmp_path / "hair.abc", scene, Blender())
    with pytest.raises(InputError, match="found no file"):
        write_scene(tmp_path / "hair.abc", scene, Blender(tmp_path / "python"))
    broken = tmp_path / "python"
    broken.write_text("#!/bin/sh\necho no module bpy >&2\nexit 1\n")
    broken.chmod(0o755)
    with pytest.raises(InputError, match="expected Blender to work, found: no module bpy"):
        write_scene(tmp_path / "hair.abc", scene, Blender(broken))
    assert [path.name for path in tmp_path.iterdir()] == ["python"]
