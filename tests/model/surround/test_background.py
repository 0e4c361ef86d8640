"""The background: where rays leave its shell, and what is seen there."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from neural_strands.geometry.cameras import Camera
from neural_strands.model.surround.background import (
    ENDLESS,
    SPARSE,
    Background,
    equirectangular,
    sample_around,
    shell_distances,
    wrapped,
)
from neural_strands.model.surround.body import SurroundConfig

ROWS = 180


def all_directions(rows: int) -> Float[Tensor, "3 rows columns"]:
    """The direction of each texel of a picture in all directions."""
    azimuth = ((torch.arange(2 * rows) + 0.5) / (2 * rows) - 0.5) * 2 * math.pi
    elevation = ((torch.arange(rows) + 0.5) / rows - 0.5) * math.pi
    elevation, azimuth = torch.meshgrid(elevation, azimuth, indexing="ij")
    return torch.stack([elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos()])


def box_distances(sides: tuple[float, float, float]) -> Callable[[Tensor, Tensor], Tensor]:
    """How far a ray from inside a box runs until it meets a wall; the middle of the box is the origin."""

    def distances(origin: Tensor, rays: Tensor) -> Tensor:
        half = torch.tensor(sides)[:, None, None] / 2
        start = origin[:, None, None].expand_as(rays)
        return ((half * rays.sign() - start) / rays).amin(dim=0)

    return distances


def test_the_centre_is_the_present_one_with_and_without_inference_mode():
    for inference in (False, True):
        with torch.inference_mode(inference):
            background = Background(torch.tensor([1.0, 2.0, 3.0]), SurroundConfig())
            assert background.centre_on_cpu.tolist() == [1, 2, 3]
            background.centre[0] = 4.0
            assert background.centre_on_cpu.tolist() == [4, 2, 3]


@pytest.mark.parametrize("eye", [(1.0, 2.0, 5.0), (1.3, -1.0, 3.2), (1.0, 2.0, 40.0)])
def test_the_background_is_where_rays_leave_its_shell(generator, eye):
    """Pixel by pixel on a sphere: from the centre, from beside it, and from outside, where some rays miss it."""
    background = Background(torch.tensor([1.0, 2.0, 5.0]), SurroundConfig(background_texture=8))
    background.colour.copy_(wrapped(torch.rand(3, 8, 16, generator=generator)))
    camera = Camera.look_at(torch.tensor(eye), torch.tensor([0.3, 2.5, -2.0]), 6.0, (11, 9))
    colour = background.colour[..., 1:-1].permute(1, 2, 0).double()
    found, rows, columns = background(camera), *colour.shape[:2]
    rays = camera.rays(camera.pixel_centres()).double()
    start, radius = torch.tensor(eye, dtype=torch.float64) - background.centre.double(), 10.0
    missed = 0
    for row in range(9):
        for column in range(11):
            ray = rays[row, column]
            roots = (ray @ start) ** 2 - start @ start + radius**2
            farthest = float(roots.sqrt() - ray @ start) if roots > 0 else -1.0
            missed += farthest <= 0
            x, y, z = (start + farthest * ray if farthest > 0 else ray).tolist()
            place = (math.atan2(x, z) / (2 * math.pi) + 0.5) * columns - 0.5
            height = (math.atan2(y, math.hypot(x, z)) / math.pi + 0.5) * rows - 0.5
            left, top = math.floor(place), math.floor(height)
            expected = torch.zeros(3, dtype=torch.float64)
            for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
                weight = (1 - abs(place - left - dx)) * (1 - abs(height - top - dy))
                expected += weight * colour[min(max(top + dy, 0), rows - 1), (left + dx) % columns]
            torch.testing.assert_close(found[row, column].double(), expected, rtol=0, atol=1e-4)
    assert (missed > 0) == (eye[2] > 15)


@pytest.mark.parametrize("eye", [(0.0, 0.0, 0.0), (0.3, 0.2, 0.5), (-0.6, -0.3, 0.4)])
def test_rays_end_at_the_walls_of_a_room(eye):
    walls = box_distances((2.0, 2.4, 3.0))
    nearness = wrapped(1 / walls(torch.zeros(3), all_directions(ROWS))[None])
    camera = Camera.look_at(torch.tensor(eye), torch.tensor([0.1, 0.2, -1.0]), 90.0, (120, 90))
    rays = camera.ray_planes()
    found, expected = shell_distances(camera.position, rays, nearness), walls(camera.position, rays)
    error = (found - expected).abs()
    # Edges of the room are rounded off between the sparse rays.
    assert error.median() < 0.005
    assert error.quantile(0.9) < 0.03


def test_lengths_between_sparse_rays_are_those_of_every_ray(monkeypatch: pytest.MonkeyPatch):
    walls = box_distances((4.0, 4.0, 4.0))
    nearness = wrapped(1 / walls(torch.zeros(3), all_directions(ROWS))[None])
    camera = Camera.look_at(torch.tensor([0.2, 0.1, 0.5]), torch.tensor([0.0, 0.0, -1.0]), 200.0, (131, 70))
    sparse = shell_distances(camera.position, camera.ray_planes(), nearness)
    assert SPARSE > 1
    monkeypatch.setattr("neural_strands.model.surround.background.SPARSE", 1)
    torch.testing.assert_close(
        sparse, shell_distances(camera.position, camera.ray_planes(), nearness), rtol=2e-3, atol=0
    )


def test_rays_that_miss_the_shell_are_endless():
    nearness = torch.full((1, ROWS, 2 * ROWS + 2), 2.0)
    rays = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]).T[:, None]
    found = shell_distances(torch.tensor([0.0, 0.0, 3.0]), rays, nearness)
    assert found.tolist() == [[ENDLESS, 3.5]]


def test_pictures_in_all_directions_have_no_seam(generator):
    picture = torch.rand(2, 5, 10, generator=generator)
    around = all_directions(5)
    torch.testing.assert_close(sample_around(wrapped(picture), around), picture, atol=1e-5, rtol=0)
    behind = torch.tensor([[-1e-4, 0.0, -1.0], [1e-4, 0.0, -1.0]]).T[:, None]
    left, right = sample_around(wrapped(picture), behind)[:, 0].T
    torch.testing.assert_close(left, right, atol=1e-3, rtol=0)
    torch.testing.assert_close(left, (picture[:, 2, 0] + picture[:, 2, -1]) / 2, atol=1e-3, rtol=0)


def test_up_and_the_front_are_where_the_page_says():
    u, v = equirectangular(torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T[:, None])
    assert u[0].tolist()[:2] == [0.5, 0.75]
    assert v[0].tolist() == pytest.approx([0.5, 0.5, 1.0])


def test_a_person_who_moves_does_not_move_the_background(generator):
    background = Background(torch.zeros(3), SurroundConfig(background_texture=8))
    background.colour.copy_(wrapped(torch.rand(3, 8, 16, generator=generator)))
    still = Camera.look_at(torch.tensor([0.3, 0.1, 1.0]), torch.zeros(3), 6.0, (11, 9))
    motion = torch.eye(4)
    motion[:3, :3] = Camera.look_at(torch.tensor([0.1, 0.0, 1.0]), torch.zeros(3), 1.0, (1, 1)).rotation
    motion[:3, 3] = torch.tensor([0.02, 0.0, 0.05])
    # Relative to the person, the camera moves.
    moved = replace(still, world_to_camera=still.world_to_camera @ motion, world_to_room=motion)
    torch.testing.assert_close(background(moved), background(still), atol=1e-5, rtol=0)
    assert not torch.allclose(background(replace(moved, world_to_room=None)), background(still), atol=0.05)
