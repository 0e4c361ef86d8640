"""The skull rises to the lowest hair above it, found in points and in pictures, and the face stays where it is."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, interpolate, vertex_normals
from neural_strands.geometry.mesh_queries import closest_points
from neural_strands.geometry.views import View, Views
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.crown import FEWEST, MOST, over_skull, raise_skull, skull_lift
from neural_strands.raster.triangles import rasterise_triangles
from tests.support.placed_template import placed_template

HIGHER = 0.010
"""Height by which the person's crown exceeds the template's, metres."""


@pytest.fixture(scope="module")
def fitted() -> FittedHead:
    return replace(placed_template(), figures={"scale_error": 0.03})


def brow_height(fitted: FittedHead) -> float:
    return float(fitted.landmarks[[NAMED["right_brow_inner"], NAMED["left_brow_inner"]], 1].mean())


def person(fitted: FittedHead) -> Mesh:
    """The head of a person with a larger skull: what lies above the brows is scaled about a point between the ears."""
    mesh, brow = fitted.head.mesh, brow_height(fitted)
    vertices, centre = mesh.vertices, torch.tensor([0.0, brow, 0.0])
    rise = vertices[:, 1] - brow
    larger = HIGHER / float(rise.max()) * (rise / 0.03).clamp(0, 1)
    return Mesh(centre + (1 + larger[:, None]) * (vertices - centre), mesh.faces)


def hair(fitted: FittedHead, lowest: float, highest: float, count: int = 20_000) -> torch.Tensor:
    """Points above the person's scalp, at heights evenly spread between two."""
    random, mesh = torch.Generator().manual_seed(0), person(fitted)
    corners = mesh.faces[fitted.head.scalp_faces][
        torch.randint(len(fitted.head.scalp_faces), (count,), generator=random)
    ]
    weights = -torch.rand(count, 3, generator=random).log()
    weights = (weights / weights.sum(dim=1, keepdim=True))[..., None]
    height = lowest + (highest - lowest) * torch.rand(count, 1, generator=random)
    return (weights * mesh.vertices[corners]).sum(1) + height * (weights * vertex_normals(mesh)[corners]).sum(1)


def lift_everywhere(fitted: FittedHead, points: torch.Tensor) -> float:
    """The lift without views that look down on the skin."""
    lift = skull_lift(fitted, points, ())
    assert len(lift.places) == 0
    return lift.everywhere


def test_the_skull_is_too_low_by_as_much_as_the_lowest_hair_shows(fitted: FittedHead):
    assert lift_everywhere(fitted, hair(fitted, 0.0, 0.03)) == pytest.approx(HIGHER, abs=0.003)
    # Hair that nowhere touches the skin says that the skull is higher than it is, but not without limit.
    assert lift_everywhere(fitted, hair(fitted, 0.03, 0.06)) == MOST


def test_hair_at_the_skin_moves_nothing(fitted: FittedHead):
    at_skin = hair(fitted, -0.002, 0.0)
    own = closest_points(at_skin, fitted.head.mesh).position
    assert lift_everywhere(fitted, own) < 1e-4
    # A parting is enough: a twentieth of the hair at the skin, the rest two centimetres above the person's.
    far = hair(fitted, 0.02, 0.03)
    assert lift_everywhere(fitted, torch.cat([own[: len(own) // 20], far])) < 0.001


def test_a_few_points_prove_nothing(fitted: FittedHead):
    assert lift_everywhere(fitted, hair(fitted, 0.0, 0.03, FEWEST // 2)) == 0.0
    # Hair beside and below the ears lies far off any skull.
    below = hair(fitted, 0.0, 0.03)
    assert lift_everywhere(fitted, below[below[:, 1] < brow_height(fitted)]) == 0.0
    # A few wrong points deep inside the head do not hold it down.
    wrong = hair(fitted, -0.03, -0.02)[:200]
    assert lift_everywhere(fitted, torch.cat([hair(fitted, 0.0, 0.03), wrong])) > 0.5 * HIGHER


def photographs(fitted: FittedHead, views: int = 14, side: int = 240) -> Views:
    """Hair that lies close to the person's skull, with streaks from front to back, seen from around and above."""
    mesh = person(fitted)
    shell = Mesh(mesh.vertices + 0.001 * vertex_normals(mesh), mesh.faces)
    wave = np.random.default_rng(0).uniform(0.2, 1.0, 4000).astype(np.float32)
    scalp = torch.zeros(len(mesh.faces), dtype=torch.bool)
    scalp[fitted.head.scalp_faces] = True
    taken = []
    for number in range(views):
        turn = 2 * math.pi * number / views
        height = (0.25, 0.55)[number % 2]
        eye = 0.7 * torch.tensor([math.sin(turn), height, math.cos(turn)])
        camera = Camera.look_at(eye, torch.tensor([0.0, 0.05, 0.0]), 1.9 * side, (side, side), f"{number}")
        buffer = rasterise_triangles(shell.vertices, shell.faces, camera)
        covered = buffer.face >= 0
        face = buffer.face.clamp(min=0).view(-1)
        place = interpolate(shell.corners(), face, buffer.barycentric.view(-1, 3)).view(side, side, 3)
        mask = covered & scalp[buffer.face.clamp(min=0)]
        # Streaks 1.5 mm wide at constant x, whose brightness changes slowly along them.
        streak = (place[..., 0] / 0.0015 + 1000).floor().long().clamp(0, 1999)
        along = 0.85 + 0.15 * torch.sin(place[..., 2] * 90 + streak)
        shade = torch.from_numpy(wave)[streak] * along
        image = torch.where(mask, 0.6 * shade, 0.5)[..., None].expand(-1, -1, 3).contiguous()
        taken.append(View(camera, image, mask.float(), None))
    return Views.in_memory(taken)


def test_the_skull_is_found_in_photographs(fitted: FittedHead):
    said: list[str] = []
    raised = raise_skull(fitted, photographs(fitted), said.append)
    assert raised.figures["skull_raised_mm"] == pytest.approx(1000 * HIGHER, abs=3)
    assert said == [f"The skull was raised by {raised.figures['skull_raised_mm']:.1f} mm, to the lowest hair above it."]
    true = person(fitted)
    top = true.corners()[fitted.head.scalp_faces].mean(dim=1)
    top = top[top[:, 1] > brow_height(fitted) + 0.04]
    before = closest_points(top, fitted.head.mesh).distance.mean()
    after = closest_points(top, raised.head.mesh).distance.mean()
    assert float(after) < 0.5 * float(before)
    face = fitted.head.mesh.vertices[:, 1] < brow_height(fitted)
    assert torch.equal(raised.head.mesh.vertices[face], fitted.head.mesh.vertices[face])
    assert torch.equal(raised.head.scalp_faces, fitted.head.scalp_faces)
    mouth = [NAMED["nose_tip"], NAMED["chin"]]
    assert torch.equal(raised.landmarks[mouth], fitted.landmarks[mouth])


def test_without_hair_the_skull_stays(fitted: FittedHead):
    views = photographs(fitted, views=3, side=64)
    bald = Views.in_memory([View(view.camera, view.image, torch.zeros(64, 64), None) for view in views])
    said: list[str] = []
    kept = raise_skull(fitted, bald, said.append)
    assert kept.figures == {"scale_error": 0.03, "skull_raised_mm": 0.0}
    assert torch.equal(kept.head.mesh.vertices, fitted.head.mesh.vertices)
    assert len(said) == 1
    assert "keeps the template's height" in said[0]


def test_stereo_sees_only_hair_over_the_skull(fitted: FittedHead):
    views = photographs(fitted, views=4, side=80)
    everything = Views.in_memory([View(view.camera, view.image, torch.ones(80, 80), None) for view in views])
    limited = over_skull(everything, fitted)
    top = fitted.head.mesh.vertices[fitted.head.mesh.vertices[:, 1].argmax()] + torch.tensor([0.0, 0.03, 0.0])
    chin = fitted.landmarks[NAMED["chin"]]
    for index, camera in enumerate(everything.cameras):
        mask = limited.hair_mask(index)
        assert mask is not None
        for point, value in ((top, 1.0), (chin, 0.0)):
            column, row = camera.project(point)[0].floor().long().tolist()
            assert float(mask[row, column]) == value
        assert torch.equal(limited.image(index), everything.image(index))
