import io

import numpy as np
import torch
import trimesh
from trimesh.visual import TextureVisuals

from neural_strands.foundation.srgb import to_linear
from neural_strands.geometry.mesh import Mesh
from neural_strands.viewer.clay import TOWARDS_LIGHT, clay_glb


def read_back(content):
    scene = trimesh.load(io.BytesIO(content), file_type="glb", process=False)
    assert isinstance(scene, trimesh.Scene)
    (mesh,) = scene.geometry.values()
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def ball():
    sphere = trimesh.creation.icosphere(subdivisions=3)
    return Mesh(torch.from_numpy(sphere.vertices).float(), torch.from_numpy(sphere.faces).long())


def test_a_mesh_keeps_its_shape_and_needs_no_light():
    given = ball()
    content = clay_glb(given, (200, 100, 50))
    mesh = read_back(content)
    np.testing.assert_allclose(mesh.vertices, given.vertices.numpy(), atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, given.faces.numpy())
    assert b"KHR_materials_unlit" in content


def test_what_faces_the_light_has_almost_the_colour_and_what_faces_away_is_dark():
    given = ball()
    mesh = read_back(clay_glb(given, (200, 100, 50)))
    assert isinstance(mesh.visual, TextureVisuals)
    colours = mesh.visual.vertex_attributes["color"][:, :3] / 255
    whole = to_linear(torch.tensor([200, 100, 50]) / 255).numpy()
    facing = given.vertices @ torch.tensor(TOWARDS_LIGHT)
    bright, dark = (colours[int(index)] / whole for index in (facing.argmax(), facing.argmin()))
    # 0.6 + 0.25 (1 + 0.55) / 2 + 0.15 of the light, and 0.25 (1 - 0.55) / 2 + 0.15.
    np.testing.assert_allclose(bright, 0.94, atol=0.05)
    np.testing.assert_allclose(dark, 0.21, atol=0.08)
