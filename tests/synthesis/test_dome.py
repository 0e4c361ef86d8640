"""The dome: cameras where they were asked to be, all of the hair in every frame."""

import pytest
import torch

from neural_strands.foundation.errors import InputError
from neural_strands.scalp.mannequin import mannequin
from neural_strands.synthesis.dome import DomeConfig, dome, dome_directions


@pytest.fixture
def hair(generator: torch.Generator) -> torch.Tensor:
    return torch.rand(500, 3, generator=generator) * torch.tensor([0.2, 0.35, 0.25]) - 0.1


def test_cameras_stand_at_the_distance_and_within_the_elevations(hair):
    config = DomeConfig(views=17, distance=1.3, elevation_min=-20.0, elevation_max=60.0)
    middle = (hair.amin(dim=0) + hair.amax(dim=0)) / 2
    offsets = torch.stack([camera.position for camera in dome(hair, config)]) - middle
    assert torch.allclose(offsets.norm(dim=-1), torch.full((17,), 1.3), atol=1e-5)
    elevation = torch.rad2deg(torch.asin(offsets[:, 1] / 1.3))
    assert elevation.min() > -20.0
    assert elevation.max() < 60.0
    assert (elevation.diff() < 0).all()


def test_hair_fills_the_share_of_the_frame_that_was_asked_for(hair):
    config = DomeConfig(views=9, resolution=200, fill=0.8)
    stray = torch.tensor([[0.0, 0.5, 0.0], [0.3, 0.2, 0.0]])
    for points in (hair, torch.cat([hair.repeat(4, 1), stray])):
        offset = torch.stack([(camera.project(hair)[0] - 100.0).abs().amax(dim=-1) for camera in dome(points, config)])
        # Where it is largest, nearly all of the hair lies within 0.8 of half the frame, and nearly touches its edge.
        assert (offset < 0.8 * 100.0).float().mean(dim=1).min() > 0.99
        assert 70.0 < float(offset.max()) < 90.0


def test_every_camera_sees_the_head():
    mesh = mannequin().mesh
    head = mesh.vertices[mesh.vertices[:, 1] > -0.05]
    for camera in dome(head, DomeConfig(views=12)):
        pixels, depth = camera.project(head)
        assert (depth > 0.5).all()
        assert ((pixels >= 0) & (pixels <= camera.width)).all()


def test_directions_are_spread_evenly_over_the_dome():
    directions = dome_directions(DomeConfig(views=400))
    # A spiral of equal areas: as many cameras in each quarter of heights, and no lopsided azimuth.
    quarters = torch.histc(directions[:, 1], 4, float(directions[:, 1].min()), float(directions[:, 1].max()))
    assert quarters.max() - quarters.min() <= 2
    assert directions[:, [0, 2]].mean(dim=0).abs().max() < 0.02


def test_a_frontal_dome_stays_before_the_face_and_reaches_both_sides():
    directions = dome_directions(DomeConfig(views=40, azimuth=80.0))
    azimuth = torch.rad2deg(torch.atan2(directions[:, 0], directions[:, 2]))
    assert azimuth.abs().max() <= 80.0
    assert azimuth.min() < -70.0
    assert azimuth.max() > 70.0


@pytest.mark.parametrize(
    ("config", "word"),
    [
        (DomeConfig(views=0), "views"),
        (DomeConfig(azimuth=0.0), "azimuth"),
        (DomeConfig(resolution=1), "resolution"),
        (DomeConfig(distance=0.1), "distance"),
        (DomeConfig(elevation_min=50.0, elevation_max=10.0), "elevation"),
        (DomeConfig(fill=0.0), "fill"),
    ],
)
def test_impossible_domes_are_refused_by_name(hair, config, word):
    with pytest.raises(InputError, match=word):
        dome(hair, config)
