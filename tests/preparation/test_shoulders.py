"""The template has the neck and shoulders of a mean adult, as published, and a person's outlines change them."""

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
import trimesh

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.builtin import builtin_template, with_mean_skull
from neural_strands.preparation.head.shoulder_fit import SPREAD, fit_shoulders
from neural_strands.preparation.head.shoulders import Shoulders, with_shoulders
from neural_strands.preparation.head.template import Template, bust
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.mannequin import mannequin

NECK, DELTOIDS, ACROMIA, BELOW_CROWN, CHEST = 363.7, 480.4, 390.5, 304.5, 250.6
"""ANSUR II, halfway between the means of women and men, mm: circumference of the neck, breadths at the deltoids and
between the acromia, the acromia's distance below the crown, and depth of the chest."""
NIPPLES = -0.34
"""Height of the nipples in the template's frame, metres, 46 cm below the crown: an estimate."""


@pytest.fixture(scope="module")
def template() -> Template:
    return builtin_template()


def section(mesh: Mesh, height: float) -> np.ndarray:
    """Corners (n, 2) of the convex hull of a level section, mm."""
    cut = trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False).section([0, 1, 0], [0, height, 0])
    assert cut is not None
    return 1e3 * cv2.convexHull(cut.vertices[:, [0, 2]].astype(np.float32))[:, 0]


def test_breadths_are_the_published_means(template: Template):
    mesh = template.head.mesh
    narrowest = min(cv2.arcLength(section(mesh, height), True) for height in np.arange(-0.130, -0.112, 0.002))
    assert abs(narrowest - NECK) < 8
    broadest = max(np.ptp(section(mesh, height)[:, 0]) for height in np.arange(-0.26, -0.20, 0.01))
    assert abs(broadest - DELTOIDS) < 8
    at_acromion = (mesh.vertices[:, 0].abs() - 0.0005 * ACROMIA).abs() < 0.004
    depth = mesh.vertices[:, 1].max() - mesh.vertices[at_acromion, 1].max()
    assert abs(1e3 * float(depth) - BELOW_CROWN) < 6


def test_depth_grows_evenly_from_the_neck_to_the_chest(template: Template):
    neck = np.ptp(section(template.head.mesh, -0.12)[:, 1])
    for height in (-0.16, -0.20, -0.23, -0.26):
        depth = np.ptp(section(template.head.mesh, height)[:, 1])
        assert abs(depth - np.interp(height, [NIPPLES, -0.12], [CHEST, neck])) < 12


def test_face_and_skull_stay(template: Template):
    before, after = with_mean_skull(bust(mannequin()).mesh.vertices), template.head.mesh.vertices
    head = torch.unique(template.head.mesh.faces[template.head.scalp_faces])
    assert torch.equal(before[head], after[head])
    above = before[:, 1] > -0.08
    assert torch.equal(before[above], after[above])
    marks = template.landmarks[torch.isfinite(template.landmarks).all(dim=1)]
    assert torch.equal(
        with_shoulders(marks, template.landmarks[NAMED["chin"]], Shoulders(1.0, 1.0, 1.0, 1.0, 1.0)), marks
    )


def normals(vertices: torch.Tensor, faces: torch.Tensor) -> torch.Tensor:
    corners = vertices[faces]
    return torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def test_no_triangle_is_flipped(template: Template):
    mannequins, mesh = bust(mannequin()).mesh, template.head.mesh
    cosine = torch.nn.functional.cosine_similarity(
        normals(mannequins.vertices, mesh.faces), normals(mesh.vertices, mesh.faces)
    )
    assert cosine.min() > 0.8
    assert trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy()).is_volume
    # Twice the expected size of every difference, in both directions and all combinations.
    for signs in itertools.product((-2, 2), repeat=len(SPREAD)):
        change = Shoulders(0.0, *(sign * size for sign, size in zip(signs, SPREAD, strict=True)))
        vertices = with_shoulders(mesh.vertices, template.landmarks[NAMED["chin"]], change)
        cosine = torch.nn.functional.cosine_similarity(
            normals(mesh.vertices, mesh.faces), normals(vertices, mesh.faces)
        )
        assert cosine.min() > 0.2


def person(template: Template) -> Mesh:
    """Somebody with narrower, higher shoulders, by straight lines where the template has smooth curves."""
    x, y, z = template.head.mesh.vertices.unbind(dim=1)
    lower = ((-0.11 - y) / 0.05).clamp(0, 1)
    higher = 0.03 * lower * ((x.abs() - 0.05) / 0.08).clamp(0, 1)
    return Mesh(torch.stack([(1 - 0.08 * lower) * x, y + higher, z], dim=1), template.head.mesh.faces)


HAIR = trimesh.creation.icosphere(subdivisions=3).apply_scale([0.13, 0.19, 0.13]).apply_translation([0, -0.05, -0.03])
"""Hair around head and neck that lies on the shoulders."""


def outlines(
    shown: list[Mesh], target_height: float = -0.08, focal: float = 420.0
) -> tuple[list[Camera], list[np.ndarray]]:
    """Views from all around, 20 degrees from above, and the silhouettes of meshes in them."""
    cameras, silhouettes = [], []
    for turn in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        eye = torch.tensor([np.sin(turn), target_height + 0.36, np.cos(turn)], dtype=torch.float32)
        cameras.append(Camera.look_at(eye, torch.tensor([0.0, target_height, 0.0]), focal, (256, 256)))
        drawn = [rasterise_triangles(mesh.vertices, mesh.faces, cameras[-1]).face >= 0 for mesh in shown]
        silhouettes.append(torch.stack(drawn).any(dim=0).numpy())
    return cameras, silhouettes


def breadth(mesh: Mesh) -> float:
    """Largest breadth, metres."""
    return float(mesh.vertices[:, 0].max() - mesh.vertices[:, 0].min())


def top(mesh: Mesh) -> float:
    """Height of the shoulders 17 cm from the middle, metres."""
    return float(mesh.vertices[(mesh.vertices[:, 0].abs() - 0.17).abs() < 0.005, 1].max())


@pytest.mark.parametrize("with_hair", [False, True])
def test_shoulders_follow_the_outlines(template: Template, with_hair: bool):
    true = person(template)
    hair = Mesh(torch.tensor(HAIR.vertices, dtype=torch.float32), torch.tensor(HAIR.faces))
    found, change = fit_shoulders(template, *outlines([true, hair] if with_hair else [true]))
    for measure, error in ((breadth, 0.012), (top, 0.005)):
        assert abs(measure(template.head.mesh) - measure(true)) > 0.024
        assert abs(measure(found.head.mesh) - measure(true)) < error
    assert abs(change.forward) < 0.004
    assert torch.equal(found.landmarks, template.landmarks)


def test_shoulders_outside_the_picture_keep_their_size(template: Template):
    cameras, silhouettes = outlines([person(template)], target_height=0.08, focal=1100.0)
    _, change = fit_shoulders(template, cameras, silhouettes)
    assert abs(change.breadth) < 0.01
    assert abs(change.rise) < 0.002


@pytest.mark.parametrize("value", [False, True])
def test_masks_without_an_outline_say_nothing(template: Template, value: bool):
    cameras, silhouettes = outlines([person(template)])
    _, change = fit_shoulders(template, cameras, [np.full_like(each, value) for each in silhouettes])
    torch.testing.assert_close(torch.tensor(change.rise), torch.tensor(0.0))
    torch.testing.assert_close(torch.tensor(change.breadth), torch.tensor(0.0))


def test_a_template_without_shoulders_stays(template: Template):
    mesh = template.head.mesh
    narrow = Mesh(mesh.vertices * torch.tensor([0.4, 1.0, 1.0]), mesh.faces)
    bare = replace(template, head=replace(template.head, mesh=narrow))
    found, change = fit_shoulders(bare, *outlines([person(template)]))
    assert found is bare
    assert change == Shoulders()
