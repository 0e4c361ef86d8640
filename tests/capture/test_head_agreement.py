"""Correct and misplaced heads, against masks of what cameras see of the correct one."""

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from tiny_capture import RADIUS, SIDE, ball, cameras

from neural_strands.capture.capture import Capture
from neural_strands.capture.check_head import COMPARED_VIEWS, judge_agreement
from neural_strands.capture.head import read_head
from neural_strands.capture.head_agreement import head_agreement
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import Mask, Views
from neural_strands.raster.triangles import rasterise_triangles
from neural_strands.scalp.hairline import measure_head

BACKWARD = torch.tensor([0.0, 0.8, -0.6])
"""Hair grows around this direction from the ball's middle: above and behind."""


def head() -> tuple[Mesh, torch.Tensor]:
    made = ball()
    mesh = Mesh(torch.from_numpy(made.vertices).float(), torch.from_numpy(made.faces).long())
    return mesh, torch.nonzero(mesh.corners().mean(dim=1) @ BACKWARD > 0.1 * RADIUS).squeeze(1)


def masked(found: list[Camera], hair: Sequence[Mask | None], person: Sequence[Mask | None]) -> Views:
    parts = {"hair_mask": hair, "person_mask": person}
    return Views(tuple(found), tuple(mask is not None for mask in hair), lambda index, part: parts[part][index])


def true_views() -> Views:
    """What twelve cameras see of the head and of hair a centimetre thick on its scalp."""
    mesh, scalp = head()
    count = len(mesh.vertices)
    vertices = torch.cat([mesh.vertices, mesh.vertices * (1 + 0.01 / RADIUS)])
    faces = torch.cat([mesh.faces, mesh.faces[scalp] + count])
    seen = [rasterise_triangles(vertices, faces, camera).face for camera in cameras(12)]
    hair, person = [(face >= len(mesh.faces)).float() for face in seen], [(face >= 0).float() for face in seen]
    return masked(cameras(12), list(hair), list(person))


def moved(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    return replace(mesh, vertices=mesh.vertices + torch.tensor([x, y, z]))


def changed(mesh: Mesh, factor: tuple[float, float, float], pivot: torch.Tensor) -> Mesh:
    """The mesh scaled along each axis about a point; (-1, 1, -1) turns the head backwards."""
    return replace(mesh, vertices=(mesh.vertices - pivot) * torch.tensor(factor) + pivot)


def wrong_heads(mesh: Mesh, pivot: torch.Tensor) -> dict[str, Mesh]:
    shifts = {f"{sign * 6} cm along {axis}": sign * 0.06 for axis in "xyz" for sign in (-1, 1)}
    heads = {
        name: moved(mesh, *(value if name.endswith(axis) else 0.0 for axis in "xyz")) for name, value in shifts.items()
    }
    heads["1.3 times too large"] = changed(mesh, (1.3, 1.3, 1.3), pivot)
    heads["turned backwards"] = changed(mesh, (-1.0, 1.0, -1.0), pivot)
    return heads


def test_a_head_in_its_place_is_told_from_others():
    (mesh, scalp), views = head(), true_views()
    right = head_agreement(mesh, scalp, views)
    assert right.scalp_in_hair > 0.999  # a rim of pixels
    assert right.skin_in_hair < 0.3
    assert right.head_in_person == 1.0
    assert judge_agreement(right).level == "good"
    for name, wrong in wrong_heads(mesh, torch.zeros(3)).items():
        judged = judge_agreement(head_agreement(wrong, scalp, views))
        assert judged.level in ("warning", "error"), name
        assert "same frame" in judged.action or "share one frame" in judged.action
    # Shifted upwards twice as far, the head is certainly wrong.
    assert judge_agreement(head_agreement(moved(mesh, 0, 0.12, 0), scalp, views)).level == "error"


def test_masks_of_the_person_given_as_masks_of_the_hair_are_an_error():
    (mesh, scalp), views = head(), true_views()
    person = [views.person_mask(index) for index in range(len(views))]
    judged = judge_agreement(head_agreement(mesh, scalp, masked(cameras(12), person, person)))
    assert judged.level == "error"
    assert "masks of the hair alone" in judged.action


def test_the_shares_are_those_of_a_ball_seen_pixel_by_pixel():
    """Every pixel's ray meets the ball at the solution of a quadratic equation; each mask is a half plane."""
    mesh, scalp = head()
    found = cameras(5)
    column, row = torch.meshgrid(torch.arange(SIDE), torch.arange(SIDE), indexing="xy")
    hair, person = (column < 30).float(), (row < 28).float()
    counts = torch.zeros(3, 2)
    lowest = float(mesh.corners()[scalp][..., 1].min())
    for camera in found:
        rays, eye = camera.rays(camera.pixel_centres()), camera.position
        along = -(rays @ eye)
        under = along.square() - (eye.square().sum() - RADIUS**2)
        point = eye + (along - under.clamp(min=0).sqrt())[..., None] * rays
        hit, above = under > 0, point @ BACKWARD > 0.1 * RADIUS
        skin = hit & ~above & (point[..., 1] >= lowest)
        # Scalp and head count as inside where a neighbour is.
        for k, (seen, inside) in enumerate(((hit & above, column <= 30), (skin, column < 30), (hit, row <= 28))):
            counts[k] += torch.tensor([float((seen & inside).sum()), float(seen.sum())])
    expected = (counts[:, 0] / counts[:, 1]).tolist()
    agreement = head_agreement(mesh, scalp, masked(found, [hair] * 5, [person] * 5))
    shares = (agreement.scalp_in_hair, agreement.skin_in_hair, agreement.head_in_person)
    assert shares == pytest.approx(expected, abs=0.02)


def test_what_no_view_tells_is_none():
    (mesh, scalp), found = head(), cameras(4)
    nothing = head_agreement(mesh, scalp, masked(found, [None] * 4, [None] * 4))
    assert (nothing.scalp_in_hair, nothing.skin_in_hair, nothing.head_in_person) == (None, None, None)
    assert judge_agreement(nothing) is None
    ones = [torch.ones(SIDE, SIDE)] * 4
    only_person = head_agreement(mesh, scalp, masked(found, [None] * 4, ones))
    assert (only_person.scalp_in_hair, only_person.head_in_person) == (None, 1.0)
    unseen = head_agreement(moved(mesh, 0, math.inf, 0), scalp, masked(found, ones, ones))
    assert unseen.scalp_in_hair is None


@pytest.mark.parametrize("name", ["sintel_bob", "straight_long"])
def test_true_heads_of_captures_are_told_from_wrong_ones(shared_data, name):
    capture = Capture.load(shared_data / "captures" / name)
    file = read_head(capture)
    assert file is not None
    assert file.scalp_faces is not None
    mesh, scalp = file.mesh, file.scalp_faces
    places = torch.linspace(0, len(capture) - 1, COMPARED_VIEWS).round().int().tolist()
    views = capture.subset(places).views_on()
    hair = [mask for index in range(len(views)) if (mask := views.hair_mask(index)) is not None]
    bodies = [(rasterise_triangles(mesh.vertices, mesh.faces, camera).face >= 0).float() for camera in views.cameras]
    person = [torch.maximum(mask, body) for mask, body in zip(hair, bodies, strict=True)]
    both = masked(list(views.cameras), hair, person)
    right = head_agreement(mesh, scalp, both)
    assert right.scalp_in_hair > 0.985
    assert right.skin_in_hair < 0.75
    assert right.head_in_person > 0.99
    assert judge_agreement(right).level == "good"
    measure = measure_head(mesh.vertices)
    middle = measure.crown - torch.tensor([0.0, 0.6 * measure.width, 0.0])
    for case, wrong in wrong_heads(mesh, middle).items():
        # Judged by the hair masks alone, because few captures have masks of the person.
        assert judge_agreement(head_agreement(wrong, scalp, views)).level == "warning", case
    assert judge_agreement(head_agreement(mesh, scalp, masked(list(views.cameras), person, person))).level == "error"
