"""From views to segments, on a striped ball whose surface and stripes are known exactly; and bad input."""

import logging
import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import trimesh

from neural_strands.foundation.errors import InputError
from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh
from neural_strands.geometry.views import View, Views
from neural_strands.lmvs.reconstruct import LmvsConfig, reconstruct

RADIUS = 0.1


def camera(azimuth: float, elevation: float, size: int = 160) -> Camera:
    eye = torch.tensor(
        [math.cos(elevation) * math.sin(azimuth), math.sin(elevation), math.cos(elevation) * math.cos(azimuth)]
    )
    return Camera.look_at(eye, torch.zeros(3), 4.2 * size, (size, size), f"view_{azimuth:.2f}_{elevation:.2f}")


def see(view: Camera) -> tuple[torch.Tensor, torch.Tensor]:
    """Image and mask of a ball with uneven stripes along its meridians (poles on the y axis), by ray casting."""
    generator = torch.Generator().manual_seed(3)
    rays = view.rays(view.pixel_centres())
    middle = -(rays @ view.position)
    square = view.position.square().sum() - middle**2
    hit = square < RADIUS**2
    point = view.position + rays * (middle - (RADIUS**2 - square).clamp(min=0).sqrt())[..., None]
    longitude = torch.atan2(point[..., 0], point[..., 2])
    latitude = torch.asin((point[..., 1] / RADIUS).clamp(-1, 1))
    value = torch.full_like(longitude, 0.4)
    for _ in range(24):
        count = int(torch.randint(20, 150, (1,), generator=generator))
        phase, drift = torch.rand(2, generator=generator) * 6.2832
        # Stripes fade in and out along the meridian, so that there is something to match along it as well.
        value += 0.07 * torch.cos(count * longitude + phase) * torch.cos(6 * latitude + drift)
    grey = torch.where(hit, value.clamp(0, 1), 0.5)
    return grey[..., None].expand(-1, -1, 3).contiguous(), hit.float()


def views_of(cameras: list[Camera]) -> list[View]:
    return [View(one, *see(one)) for one in cameras]


def ring() -> list[Camera]:
    return [camera(0.4 * k, 0.35 * (-1) ** k) for k in range(8)]


@pytest.mark.slow
def test_a_striped_ball_comes_back(generator: torch.Generator):
    found = reconstruct(Views.in_memory(views_of(ring())), None, LmvsConfig(), generator)
    assert len(found) > 2000
    distance = (found.points.norm(dim=-1) - RADIUS).abs()
    assert distance.median() < 0.002
    meridian = torch.stack([-found.points[:, 0], torch.zeros(len(found)), -found.points[:, 2]], dim=-1)
    away = torch.nn.functional.normalize(meridian, dim=-1)
    outward = torch.nn.functional.normalize(found.points, dim=-1)
    tangent = torch.nn.functional.normalize(away - (away * outward).sum(-1, keepdim=True) * outward, dim=-1)
    low = found.points[:, 1].abs() < 0.07
    angle = torch.rad2deg(torch.arccos((found.directions * tangent).sum(-1).abs().clamp(max=1)))
    assert angle[low].median() < 8
    assert torch.allclose(found.directions.norm(dim=-1), torch.ones(len(found)), atol=1e-4)


def test_the_capture_decides_whether_guesses_fill_gaps(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    views = views_of([camera(0.4 * k, 0.35 * (-1) ** k, size=80) for k in range(6)])

    def found(config: LmvsConfig) -> int:
        random = torch.Generator().manual_seed(0)
        return reconstruct(Views.in_memory(views), None, config, random, tmp_path / "work").segment_count

    sure, full = found(LmvsConfig(complete="never")), found(LmvsConfig(complete="always"))
    assert full > sure > 0
    with caplog.at_level(logging.WARNING):
        # Any share is more than none, and less than more than all.
        assert found(LmvsConfig(filled=0.0)) == sure
        assert "fill the gaps" not in caplog.text
        assert found(LmvsConfig(filled=1.01)) == full
        assert "lines that one view alone sees fill the gaps" in caplog.text
    # Nothing is filled where there are no masks to say what is hair.
    bare = [View(view.camera, view.image) for view in views]
    ids = reconstruct(
        Views.in_memory(bare), None, LmvsConfig(complete="always"), torch.Generator().manual_seed(0)
    ).segment_id
    assert (torch.bincount(ids) > 2).all()


def test_a_stopped_run_continues_to_the_same_bits(tmp_path: Path):
    views = Views.in_memory(views_of([camera(0.4 * k, 0.35 * (-1) ** k, size=80) for k in range(6)]))

    def found() -> LineSegments:
        return reconstruct(views, None, LmvsConfig(), torch.Generator().manual_seed(0), tmp_path / "work")

    whole = found()
    # Stopped while lines are matched, and before that, while features are found.
    for left in (["lines_0000*", "features*"], ["features_0002*"]):
        kept = {path for pattern in left for path in (tmp_path / "work").glob(pattern)}
        for path in {*(tmp_path / "work").glob("*.npz")} - kept:
            path.unlink()
        again = found()
        assert torch.equal(again.segment_id, whole.segment_id)
        assert torch.equal(again.points, whole.points)
        assert torch.equal(again.directions, whole.directions)


def test_a_single_view_is_refused(generator: torch.Generator):
    with pytest.raises(InputError, match="at least two views"):
        reconstruct(Views.in_memory(views_of(ring()[:1])), None, LmvsConfig(), generator)


def test_views_without_hair_or_texture_are_named(generator: torch.Generator, caplog: pytest.LogCaptureFixture):
    first, second, third = views_of(ring()[:3])
    size = (160, 160)
    bald = replace(second, hair_mask=torch.zeros(size))
    white = replace(third, image=torch.ones(*size, 3))
    with caplog.at_level(logging.WARNING), pytest.raises(InputError, match="found it in 1"):
        reconstruct(Views.in_memory([first, bald, white]), None, LmvsConfig(), generator)
    assert f"{second.camera.name}: no hair" in caplog.text
    assert f"{third.camera.name}: no texture" in caplog.text


def test_a_mask_thinner_than_the_coarsest_grid_stops_nothing(generator: torch.Generator):
    first, second, third = views_of(ring()[:3])
    line = torch.zeros(160, 160)
    line[81:84, 50:110] = 1.0
    found = reconstruct(Views.in_memory([first, second, replace(third, hair_mask=line)]), None, LmvsConfig(), generator)
    assert len(found) > 100


def test_a_camera_in_another_unit_is_named(generator: torch.Generator, caplog: pytest.LogCaptureFixture):
    first, second = views_of(ring()[:2])
    eye = 1000 * second.camera.position
    far = Camera.look_at(eye, torch.zeros(3), 4.2 * 160, (160, 160), "in millimetres")
    with caplog.at_level(logging.WARNING), pytest.raises(InputError, match="found it in 1"):
        reconstruct(Views.in_memory([first, replace(second, camera=far)]), None, LmvsConfig(), generator)
    assert "in millimetres: wrong scale" in caplog.text


def test_a_camera_inside_the_head_and_a_head_of_another_scale(
    generator: torch.Generator, caplog: pytest.LogCaptureFixture
):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=RADIUS)
    head = Mesh(torch.tensor(ball.vertices).float(), torch.tensor(ball.faces).long())
    views = views_of(ring()[:2])
    close = Camera.look_at(torch.tensor([0.0, 0.0, 0.02]), torch.tensor([0.0, 0.0, 1.0]), 100.0, (160, 160), "inner")
    inner = replace(views[0], camera=close)
    with caplog.at_level(logging.WARNING), pytest.raises(InputError, match="found it in 1"):
        reconstruct(Views.in_memory([views[0], inner]), head, LmvsConfig(), generator)
    assert "inner: its camera lies inside the head" in caplog.text
    huge = Mesh(head.vertices * 1000, head.faces)
    far = Mesh(head.vertices + 5.0, head.faces)
    with pytest.raises(InputError, match="wrong scale: expected a head in metres"):
        reconstruct(Views.in_memory(views), huge, LmvsConfig(), generator)
    with pytest.raises(InputError, match="one scale and frame"):
        reconstruct(Views.in_memory(views), far, LmvsConfig(), generator)
