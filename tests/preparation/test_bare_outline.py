"""Ears and jaw move to the person's outline where it is not hair; the back keeps beneath hair that hangs over it."""

import math
from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.views import View, Views
from neural_strands.preparation.face.topology import INTERIOR
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.bare_outline import to_bare_outline
from neural_strands.raster.triangles import rasterise_triangles
from tests.support.placed_template import placed_template

SIDE = 320
BACK = -0.06
"""What shows the person farther back than this is hair, metres."""
WIDER = 0.010
"""How far the person's ears and jaw stand out beyond the template's, metres."""


@pytest.fixture(scope="module")
def fitted() -> FittedHead:
    return placed_template()


def side_share(vertices: torch.Tensor) -> torch.Tensor:
    """1 at ears and corners of the jaw, 0 towards the face, the skull and the shoulders."""
    x, y, _ = vertices.unbind(dim=1)
    level = torch.exp(-(((y + 0.035) / 0.05) ** 2))
    return level * ((x.abs() - 0.045) / 0.02).clamp(0, 1) * (y > -0.13)


def person(fitted: FittedHead) -> Mesh:
    mesh = fitted.head.mesh
    aside = torch.zeros_like(mesh.vertices)
    aside[:, 0] = WIDER * side_share(mesh.vertices) * mesh.vertices[:, 0].sign()
    return Mesh(mesh.vertices + aside, mesh.faces)


def photographs(shown: Mesh, hair_above: float = math.inf, count: int = 9) -> Views:
    """Masks of a mesh from in front; what shows it above a height is hair."""
    views = []
    for number in range(count):
        turn = math.radians(-60 + 120 * number / (count - 1))
        eye = torch.tensor([0.8 * math.sin(turn), (-0.1, 0.1)[number % 2], 0.8 * math.cos(turn)])
        camera = Camera.look_at(eye, torch.tensor([0.0, -0.03, 0.0]), 2.0 * SIDE, (SIDE, SIDE), f"{number}")
        buffer = rasterise_triangles(shown.vertices, shown.faces, camera)
        covered = buffer.face >= 0
        height = shown.corners()[buffer.face.clamp(min=0)].mean(dim=2)[..., 1]
        hair = (covered & (height > hair_above)).float()
        views.append(View(camera, torch.zeros(SIDE, SIDE, 3), hair, covered.float()))
    return Views.in_memory(views)


def differing(fitted: FittedHead, head: FittedHead) -> int:
    """Pixels in which the silhouettes of person and head differ above the shoulders, in views between the others."""
    count = 0
    for turn in (-0.4, -0.1, 0.1, 0.4):
        eye = torch.tensor([0.8 * math.sin(turn), 0.0, 0.8 * math.cos(turn)])
        camera = Camera.look_at(eye, torch.tensor([0.0, 0.0, 0.0]), 2.5 * SIDE, (SIDE, SIDE))
        first, second = (
            rasterise_triangles(mesh.vertices, mesh.faces, camera).face >= 0
            for mesh in (person(fitted), head.head.mesh)
        )
        lowest = int(camera.project(torch.tensor([[0.0, -0.11, 0.0]]))[0][0, 1])
        count += int((first ^ second)[:lowest].sum())
    return count


def test_ears_and_jaw_move_to_the_outline(fitted: FittedHead):
    said: list[str] = []
    moved = to_bare_outline(fitted, photographs(person(fitted)), said.append)
    assert differing(fitted, fitted) > 2000
    assert differing(fitted, moved) < 0.45 * differing(fitted, fitted)
    scalp = fitted.head.mesh.faces[fitted.head.scalp_faces].unique()
    shift = (moved.head.mesh.vertices - fitted.head.mesh.vertices).norm(dim=1)
    assert float(shift[scalp].median()) < 0.001
    inside = fitted.landmarks[list(INTERIOR)]
    marks = closest_points(inside[torch.isfinite(inside).all(dim=1)], moved.head.mesh).distance
    assert float(marks.max()) < 0.002
    assert len(said) == 1
    assert moved.figures["outline_gap_mm"] < 0.8


def test_a_head_that_is_right_stays(fitted: FittedHead):
    moved = to_bare_outline(fitted, photographs(fitted.head.mesh), lambda _: None)
    assert float((moved.head.mesh.vertices - fitted.head.mesh.vertices).norm(dim=1).max()) < 0.0008


def test_an_outline_of_hair_moves_nothing(fitted: FittedHead):
    """Everything above the shoulders is hair, and the shoulders are right."""
    moved = to_bare_outline(fitted, photographs(person(fitted), hair_above=-0.13), lambda _: None)
    above = fitted.head.mesh.vertices[:, 1] > -0.08
    shift = (moved.head.mesh.vertices - fitted.head.mesh.vertices).norm(dim=1)
    assert float(shift[above].max()) < 0.0015
    assert differing(fitted, moved) > 0.8 * differing(fitted, fitted)


def test_the_back_keeps_beneath_hair_that_hangs_over_it(fitted: FittedHead):
    """The outline of the back is that of hair, which lies 10 mm thick on it."""
    rest = fitted.head.mesh
    views = []
    for number, turn in enumerate(math.radians(angle) for angle in (-105, -90, -75, 75, 90, 105)):
        eye = torch.tensor([0.8 * math.sin(turn), -0.1, 0.8 * math.cos(turn)])
        camera = Camera.look_at(eye, torch.tensor([0.0, -0.1, -0.05]), 1.6 * SIDE, (SIDE, SIDE), f"{number}")
        buffer = rasterise_triangles(rest.vertices, rest.faces, camera)
        person = buffer.face >= 0
        behind = rest.corners()[buffer.face.clamp(min=0)].mean(dim=2)[..., 2] < BACK
        views.append(View(camera, torch.zeros(SIDE, SIDE, 3), (person & behind).float(), person.float()))
    moved = to_bare_outline(fitted, Views.in_memory(views), lambda _: None).head.mesh
    x, y, z = rest.vertices.unbind(dim=1)
    spine = (x.abs() < 0.02) & (z < BACK - 0.02) & (y < y.min() + 0.08) & (y > y.min() + 0.05)
    forward = (moved.vertices - rest.vertices)[:, 2]
    assert int(spine.sum()) > 5
    assert 0.006 < float(forward[spine].median()) < 0.013
    chest = (x.abs() < 0.02) & (z > 0.0) & (y < -0.16)
    assert float(forward[chest].abs().median()) < 0.003


@pytest.mark.parametrize("missing", ["person_mask", "hair_mask"])
def test_without_masks_it_stays(fitted: FittedHead, missing: str):
    views = [replace(view, **{missing: None}) for view in photographs(person(fitted), count=2)]
    assert to_bare_outline(fitted, Views.in_memory(views), lambda _: None) is fitted
