"""Where views look down on the skin between hairs, the skull rises to it, by different amounts at front and back."""

import math

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh, vertex_normals
from neural_strands.geometry.signed_distance import signed_distance
from neural_strands.preparation.face.topology import NAMED
from neural_strands.preparation.head.fit import FittedHead
from neural_strands.preparation.head.refinement.crown import MOST, skull_lift
from neural_strands.preparation.head.refinement.lift import SkullLift
from neural_strands.preparation.head.refinement.lowest_hair import lowest_hair
from tests.support.placed_template import placed_template


@pytest.fixture(scope="module")
def fitted() -> FittedHead:
    return placed_template()


def brow(fitted: FittedHead) -> float:
    return float(fitted.landmarks[[NAMED["right_brow_inner"], NAMED["left_brow_inner"]], 1].mean())


def person(fitted: FittedHead) -> Mesh:
    """A person whose skull is higher by 4 mm at the back, 8 mm at the crown and 12 mm at the forehead."""
    mesh = fitted.head.mesh
    vertices = mesh.vertices
    above = ((vertices[:, 1] - brow(fitted)) / 0.03).clamp(0, 1)
    height = (0.008 + 0.05 * vertices[:, 2]).clamp(0.004, 0.012) * above
    return Mesh(vertices + height[:, None] * vertex_normals(mesh), mesh.faces)


def hair(fitted: FittedHead, heights: tuple[float, float], count: int = 40_000) -> torch.Tensor:
    """Points above the person's scalp, at heights spread evenly between two, metres."""
    random, mesh = torch.Generator().manual_seed(0), person(fitted)
    chosen = torch.randint(len(fitted.head.scalp_faces), (count,), generator=random)
    corners = mesh.faces[fitted.head.scalp_faces][chosen]
    weights = -torch.rand(count, 3, generator=random).log()
    weights = (weights / weights.sum(dim=1, keepdim=True))[..., None]
    up = heights[0] + (heights[1] - heights[0]) * torch.rand(count, 1, generator=random)
    return (weights * mesh.vertices[corners]).sum(1) + up * (weights * vertex_normals(mesh)[corners]).sum(1)


def cameras(elevations: tuple[float, ...]) -> list[Camera]:
    """A ring of ten cameras at each elevation, degrees."""
    eyes = [
        0.8 * torch.tensor([math.sin(turn) * math.cos(up), math.sin(up), math.cos(turn) * math.cos(up)])
        for up in map(math.radians, elevations)
        for turn in (2 * math.pi * step / 10 for step in range(10))
    ]
    target = torch.tensor([0.0, 0.05, 0.0])
    return [Camera.look_at(target + eye, target, 400.0, (240, 240), str(index)) for index, eye in enumerate(eyes)]


def misfit(fitted: FittedHead, lift: SkullLift) -> tuple[float, float]:
    """Largest and mean distance of the raised skull from the person's, well above the brows, metres."""
    raised = lift.applied(fitted).head
    points = raised.scalp_mesh.corners().mean(dim=1)
    points = points[points[:, 1] > brow(fitted) + 0.05]
    distance = signed_distance(points, person(fitted)).distance.abs()
    return float(distance.quantile(0.95)), float(distance.mean())


def test_front_and_back_rise_by_what_their_own_hair_shows(fitted: FittedHead):
    points = hair(fitted, (0.0, 0.012))
    lift = skull_lift(fitted, points, cameras((10.0, 40.0, 70.0)))
    _, flat = misfit(fitted, SkullLift(lift.everywhere, torch.zeros(0, 3), torch.zeros(0)))
    worst, mean = misfit(fitted, lift)
    assert mean < 0.0012
    assert mean < 0.5 * flat
    assert worst < 0.004
    face = fitted.head.mesh.vertices[:, 1] < brow(fitted)
    assert torch.equal(lift.applied(fitted).head.mesh.vertices[face], fitted.head.mesh.vertices[face])


def test_hair_that_hides_the_skin_shows_no_height(fitted: FittedHead):
    hidden = hair(fitted, (0.003, 0.070))
    assert len(lowest_hair(fitted, hidden, cameras((10.0, 40.0, 70.0)))[1]) == 0


def test_hair_that_stands_off_the_head_shows_no_height(fitted: FittedHead):
    shell = hair(fitted, (0.025, 0.027))
    assert len(lowest_hair(fitted, shell, cameras((10.0, 40.0, 70.0)))[1]) == 0


def test_views_that_graze_the_skull_see_only_the_outermost_hair(fitted: FittedHead):
    points = hair(fitted, (0.008, 0.010))
    places, _ = lowest_hair(fitted, points, cameras((-20.0, 0.0)))
    # From the side, only the skull's sides are looked down on.
    assert bool((places[:, 1] < 0.75).all())
    assert len(places) < len(lowest_hair(fitted, points, cameras((0.0, 40.0, 70.0)))[0])
    assert len(lowest_hair(fitted, points, cameras((70.0,))[:2])[0]) == 0


def test_the_skull_is_neither_lowered_nor_raised_without_limit(fitted: FittedHead):
    deep = hair(fitted, (-0.030, -0.028))
    lowered = skull_lift(fitted, deep, cameras((10.0, 40.0, 70.0)))
    assert lowered.is_none
    assert torch.equal(lowered.applied(fitted).head.mesh.vertices, fitted.head.mesh.vertices)
    high = skull_lift(fitted, hair(fitted, (0.006, 0.007)), cameras((10.0, 40.0, 70.0)))
    assert float(high.at(fitted, fitted.head.scalp_mesh.corners().mean(dim=1)).max()) <= MOST + 1e-6
