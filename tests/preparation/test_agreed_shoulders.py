"""Shoulders move to the person's where drawn photographs show a pattern on them, and nowhere else."""

import math
from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, interpolate, vertex_normals
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.views import View, Views
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.agreed_shoulders import FEWEST, agreed_shoulders
from neural_strands.preparation.head.shoulders import shoulder_share
from neural_strands.raster.triangles import rasterise_triangles
from tests.support.placed_template import placed_template

CLOTHES = 0.012
"""Thickness of the clothes at the breast bone, metres."""
SIDE = 240


@pytest.fixture(scope="module")
def fitted() -> FittedHead:
    return placed_template()


def share(fitted: FittedHead) -> torch.Tensor:
    return shoulder_share(fitted.head.mesh.vertices, fitted.landmarks[NAMED["chin"]])


def person(fitted: FittedHead) -> Mesh:
    """The template in clothes, thicker in front than at the back."""
    mesh = fitted.head.mesh
    front = torch.sigmoid(mesh.vertices[:, 2] / 0.05)
    return Mesh(mesh.vertices + CLOTHES * (share(fitted) * front)[:, None] * vertex_normals(mesh), mesh.faces)


def cloth(places: torch.Tensor) -> torch.Tensor:
    """Brightness of a fabric: waves of 9 to 25 mm in many directions."""
    random = torch.Generator().manual_seed(0)
    ways = torch.nn.functional.normalize(torch.randn(40, 3, generator=random), dim=1)
    lengths = 0.009 + 0.016 * torch.rand(40, generator=random)
    phases = 6.3 * torch.rand(40, generator=random)
    waves = torch.sin(places @ ways.T * (2 * math.pi / lengths) + phases)
    return 0.5 + 0.08 * waves.sum(dim=-1) / math.sqrt(2)


def photographs(fitted: FittedHead, count: int = 7, plain: bool = False, hairy: bool = False) -> Views:
    """The clothed person from in front, lower than the face and higher in turn."""
    mesh, taken = person(fitted), []
    for number in range(count):
        turn = math.radians(-60 + 120 * number / max(count - 1, 1))
        eye = torch.tensor([0.8 * math.sin(turn), (-0.1, 0.15)[number % 2], 0.8 * math.cos(turn)])
        camera = Camera.look_at(eye, torch.tensor([0.0, -0.12, 0.0]), 1.6 * SIDE, (SIDE, SIDE), f"{number}")
        buffer = rasterise_triangles(mesh.vertices, mesh.faces, camera)
        covered = (buffer.face >= 0).float()
        corners = interpolate(mesh.corners(), buffer.face.clamp(min=0).view(-1), buffer.barycentric.view(-1, 3))
        shade = torch.full((SIDE, SIDE), 0.5) if plain else cloth(corners).view(SIDE, SIDE).clamp(0, 1)
        image = torch.where(covered > 0, shade, 0.9)[..., None].expand(-1, -1, 3).contiguous()
        hair = covered if hairy else torch.zeros(SIDE, SIDE)
        taken.append(View(camera, image, hair, covered))
    return Views.in_memory(taken)


def gap(fitted: FittedHead, head: FittedHead) -> torch.Tensor:
    """Distances from the person's chest to a head, metres."""
    true = person(fitted)
    chest = (share(fitted) > 0.9) & (vertex_normals(true)[:, 2] > 0.6)
    inner = true.vertices[:, 1] > true.vertices[:, 1].min() + 0.03
    return closest_points(true.vertices[chest & inner], head.head.mesh).distance


def test_shoulders_move_to_the_clothes(fitted: FittedHead):
    said: list[str] = []
    moved = agreed_shoulders(fitted, photographs(fitted), said.append)
    before, after = gap(fitted, fitted), gap(fitted, moved)
    assert float(before.mean()) > 0.006
    assert float(after.mean()) < 0.25 * float(before.mean())
    assert float(after.quantile(0.9)) < 0.004
    above = share(fitted) == 0
    assert torch.equal(moved.head.mesh.vertices[above], fitted.head.mesh.vertices[above])
    torch.testing.assert_close(moved.landmarks, fitted.landmarks, rtol=0, atol=0, equal_nan=True)
    assert moved.figures["shoulders_moved_mm"] > 5
    assert said == [
        f"Neck and shoulders were moved by {moved.figures['shoulders_moved_mm']:.1f} mm in the median, to where "
        "photographs agree."
    ]


def test_shoulders_that_are_right_stay(fitted: FittedHead):
    right = replace(fitted, head=replace(fitted.head, mesh=person(fitted)))
    moved = agreed_shoulders(right, photographs(fitted), lambda _: None)
    assert float((moved.head.mesh.vertices - right.head.mesh.vertices).norm(dim=1).max()) < 0.004
    assert moved.figures["shoulders_moved_mm"] < 0.6


@pytest.mark.parametrize("case", ["plain cloth", "covered by hair", "too few photographs", "no mask of the person"])
def test_without_evidence_shoulders_stay(fitted: FittedHead, case: str):
    count = FEWEST - 1 if case == "too few photographs" else FEWEST
    views = photographs(fitted, count, plain=case == "plain cloth", hairy=case == "covered by hair")
    if case == "no mask of the person":
        views = Views.in_memory([replace(view, person_mask=None) for view in views])
    moved = agreed_shoulders(fitted, views, lambda _: None)
    assert float((moved.head.mesh.vertices - fitted.head.mesh.vertices).norm(dim=1).max()) < 1e-5


def test_a_template_without_a_chin_stays(fitted: FittedHead):
    landmarks = fitted.landmarks.clone()
    landmarks[NAMED["chin"]] = math.nan
    unknown = replace(fitted, landmarks=landmarks)
    moved = agreed_shoulders(unknown, photographs(fitted, FEWEST), lambda _: None)
    assert torch.equal(moved.head.mesh.vertices, fitted.head.mesh.vertices)
