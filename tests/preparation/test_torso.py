"""A bust is continued downwards where photographs show more of the person, and only there."""

from dataclasses import replace

import pytest
import torch
import trimesh

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import View, Views
from neural_strands.preparation.head.builtin import builtin_template
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.torso import FEWEST, ROWS, STEP, with_torso
from neural_strands.preparation.head.template import Template
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.fit_similarity import Similarity

SIDE = 192


@pytest.fixture(scope="module")
def template() -> Template:
    return builtin_template()


def fitted_to(template: Template, shift: torch.Tensor | None = None) -> FittedHead:
    frame = Similarity(1.0, torch.eye(3).double(), torch.zeros(3).double())
    head, mesh = template.head, template.head.mesh
    vertices = mesh.vertices if shift is None else mesh.vertices + shift
    return FittedHead(replace(head, mesh=replace(mesh, vertices=vertices)), template.landmarks, frame, {})


def trunk(lowest: float) -> Mesh:
    """A body below the shoulders as a box, down to a height."""
    top = -0.24
    box = trimesh.creation.box([0.46, top - lowest, 0.19])
    box.apply_translation([0.0, 0.5 * (lowest + top), -0.04])
    return Mesh(torch.from_numpy(box.vertices).float(), torch.from_numpy(box.faces).long())


def photographs(
    template: Template, body: Mesh | None, count: int = FEWEST, target: float = -0.10, hairy: bool = False
) -> Views:
    """Silhouettes of template and body from in front."""
    views = []
    for number in range(count):
        eye = torch.tensor([0.4 * (number - 0.5 * (count - 1)), target, 1.0])
        camera = Camera.look_at(eye, torch.tensor([0.0, target, 0.0]), 1.5 * SIDE, (SIDE, SIDE), f"{number}")
        meshes = [template.head.mesh] + ([] if body is None else [body])
        drawn = [rasterise_triangles(mesh.vertices, mesh.faces, camera).face >= 0 for mesh in meshes]
        person = torch.stack(drawn).any(dim=0).float()
        hair = person if hairy else torch.zeros(SIDE, SIDE)
        views.append(View(camera, torch.zeros(SIDE, SIDE, 3), hair, person))
    return Views.in_memory(views)


def lowest(head: FittedHead) -> float:
    return float(head.head.mesh.vertices[:, 1].min())


@pytest.mark.parametrize("target", [-0.05, -0.12])
def test_it_reaches_the_lower_edge_of_the_photographs(template: Template, target: float):
    longer = with_torso(fitted_to(template), template, photographs(template, trunk(-0.75), target=target))
    # The front of the body is about 0.95 m from the cameras, which show 1/3 of their distance below the middle.
    edge = target - 0.95 / 3
    # The old underside, 25 mm high, lies below the edge, where no photograph shows it.
    assert edge - 0.05 < lowest(longer) < edge - 0.02
    mesh = longer.head.mesh
    solid = trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False)
    assert solid.is_volume


def test_it_ends_where_the_body_does(template: Template):
    end = -0.36
    longer = with_torso(fitted_to(template), template, photographs(template, trunk(end), target=-0.3))
    assert abs(lowest(longer) - end) < 0.02


def test_it_has_a_largest_length(template: Template):
    longer = with_torso(fitted_to(template), template, photographs(template, trunk(-1.5), target=-0.4))
    assert lowest(longer) == pytest.approx(lowest(fitted_to(template)) - ROWS * STEP, abs=1e-6)


def test_everything_above_keeps_its_place_and_number(template: Template):
    before = fitted_to(template)
    uv = torch.rand(len(before.head.mesh.faces), 3, 2, generator=torch.Generator().manual_seed(0))
    before = replace(before, head=replace(before.head, mesh=replace(before.head.mesh, corner_uv=uv)))
    after = with_torso(before, template, photographs(template, trunk(-0.75)))
    old, new = before.head.mesh, after.head.mesh
    above = old.vertices[:, 1] > old.vertices[:, 1].min() + 0.03
    assert torch.equal(new.vertices[: len(old.vertices)][above], old.vertices[above])
    upper = above[old.faces].all(dim=1)
    assert torch.equal(new.faces[: len(old.faces)][upper], old.faces[upper])
    assert new.corner_uv is not None
    assert torch.equal(new.corner_uv[: len(uv)], uv)
    assert len(new.corner_uv) == len(new.faces)
    assert torch.equal(after.head.scalp_faces, before.head.scalp_faces)
    # The underside is the old one, lower.
    shift = old.vertices[~above] - new.vertices[: len(old.vertices)][~above]
    assert torch.all(shift[:, [0, 2]] == 0)


def test_a_bust_that_was_bent_is_continued(template: Template):
    """After a fit its underside is not level."""
    shift = torch.zeros_like(template.head.mesh.vertices)
    shift[:, 1] = 0.15 * template.head.mesh.vertices[:, 0]
    longer = with_torso(fitted_to(template, shift), template, photographs(template, trunk(-0.75), target=-0.2))
    mesh = longer.head.mesh
    assert trimesh.Trimesh(mesh.vertices.numpy(), mesh.faces.numpy(), process=False).is_volume
    assert lowest(longer) < lowest(fitted_to(template, shift)) - 0.1


@pytest.mark.parametrize("case", ["no body", "no masks of the person", "too few photographs", "hair over everything"])
def test_without_evidence_it_stays(template: Template, case: str):
    count = FEWEST - 1 if case == "too few photographs" else FEWEST
    body = None if case == "no body" else trunk(-0.75)
    views = photographs(template, body, count, target=-0.2, hairy=case == "hair over everything")
    if case == "no masks of the person":
        views = Views.in_memory([replace(view, person_mask=None) for view in views])
    before = fitted_to(template)
    assert with_torso(before, template, views) is before


def test_a_template_without_shoulders_stays(template: Template):
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    mesh = Mesh(torch.from_numpy(ball.vertices).float(), torch.from_numpy(ball.faces).long())
    narrow = replace(template, head=replace(template.head, mesh=mesh))
    before = fitted_to(narrow)
    assert with_torso(before, narrow, photographs(template, trunk(-0.75))) is before
