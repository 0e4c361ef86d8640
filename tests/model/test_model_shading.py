"""Colour of points: the linear decode, and what the small network adds to it."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from neural_strands.geometry.rays import spread_directions
from neural_strands.model.hair_volume import CHANNELS
from neural_strands.model.shading import CPU_BATCH, LOBE, PointShading, ShadingConfig, fibre_angles


@pytest.mark.parametrize("hidden", [0, 8])
def test_it_starts_as_a_linear_decode_of_the_feature(hidden, generator):
    shading = PointShading(5, ShadingConfig(hidden), generator)
    descriptor, view = torch.randn(20, 9, generator=generator), torch.randn(20, 3, generator=generator)
    with torch.no_grad():
        shading.mean.copy_(torch.tensor([0.1, 0.2, 0.3]))
    around = torch.randn(20, CHANNELS, generator=generator)
    linear = descriptor[:, :5] @ shading.decode.T + shading.mean
    torch.testing.assert_close(shading(descriptor[:, :5], descriptor[:, 5:], view, around), linear)


def test_the_network_sees_direction_t_view_lights_and_surroundings(generator):
    shading = PointShading(5, ShadingConfig(), generator)
    with torch.no_grad():
        shading.outer.normal_(generator=generator)
    descriptor = torch.randn(4, 9, generator=generator, requires_grad=True)
    view = torch.randn(4, 3, generator=generator, requires_grad=True)
    around = torch.randn(4, CHANNELS, generator=generator, requires_grad=True)
    shading(descriptor[:, :5], descriptor[:, 5:], view, around).square().sum().backward()
    assert (around.grad.abs() > 0).all()
    assert (descriptor.grad.abs() > 0).all()
    assert (view.grad.abs() > 0).all()
    assert (shading.lights.grad.abs() > 0).all()


def test_no_points_have_no_colour(generator):
    shading = PointShading(5, ShadingConfig(), generator)
    assert shading(torch.zeros(0, 5), torch.zeros(0, 4), torch.zeros(0, 3), torch.zeros(0, CHANNELS)).shape == (0, 3)


def test_batches_of_points_change_nothing(generator):
    """More points than one batch, against each point shaded with only a few others."""
    shading = PointShading(5, ShadingConfig(8), generator).double()
    with torch.no_grad():
        shading.outer.normal_(generator=generator)
        shading.mean.normal_(generator=generator)
    points = CPU_BATCH + 3
    descriptor = torch.randn(points, 9, generator=generator, dtype=torch.float64, requires_grad=True)
    view, around = (torch.randn(points, size, generator=generator).double() for size in (3, CHANNELS))
    given = (descriptor[:, :5], descriptor[:, 5:], view, around)
    together = shading(*given)
    parts = zip(*(values.split(1000) for values in given), strict=True)
    apart = torch.cat([shading(*part) for part in parts])
    torch.testing.assert_close(together, apart)
    weights = [shading.outer, shading.decode, shading.mean, *shading.inner]
    for one, other in zip(
        *(torch.autograd.grad(found.square().sum(), weights) for found in (together, apart)), strict=True
    ):
        torch.testing.assert_close(one, other)


def test_its_sum_in_closed_form(generator):
    """Colour c is mean_c + decode_c . z + response_c . [1, z]; the network behind the response sees no z."""
    shading = PointShading(2, ShadingConfig(4, 1, lights=2), generator)
    with torch.no_grad():
        shading.outer.normal_(generator=generator)
        shading.mean.normal_(generator=generator)
    descriptor, view = torch.randn(3, 6, generator=generator), normalize(torch.randn(3, 3, generator=generator))
    descriptor[:, 2:5] = normalize(descriptor[:, 2:5])
    around = torch.randn(3, CHANNELS, generator=generator)
    found = shading(descriptor[:, :2], descriptor[:, 2:], view, around)
    for point, direction, hair, colour in zip(descriptor, view, around, found, strict=True):
        angles = fibre_angles(point[None, 2:5], direction[None], shading.lights)[0]
        facing = torch.cat([(hair[:3] @ direction)[None], shading.lights @ hair[:3]])
        seen = torch.cat([point[2:], direction, angles, hair, facing])
        hidden = torch.nn.functional.silu(shading.inner[0] @ seen + shading.biases[0])
        response = (shading.outer @ hidden).view(3, 3)
        own = torch.cat([torch.ones(1), point[:2]])
        torch.testing.assert_close(colour, shading.mean + shading.decode @ point[:2] + response @ own)


def test_angles_of_a_fibre_in_known_places():
    """A fibre along x, lit at 30 degrees to its normal plane; the eyes' inclination and azimuth are given."""
    sine, cosine = 0.5, 3**0.5 / 2
    light = torch.tensor([[sine, 0.0, cosine]])
    mirrored = torch.tensor([-sine, 0.0, cosine])
    aside = torch.tensor([-sine, cosine, 0.0])
    behind = torch.tensor([sine, 0.0, -cosine])
    fibre = torch.tensor([[1.0, 0.0, 0.0]]).expand(3, 3)
    found = fibre_angles(fibre, -torch.stack([mirrored, aside, behind]), light)
    lobe = math.exp(-((2 * sine / LOBE) ** 2))
    expected = [
        [sine, cosine**2, sine, 0.0, 1.0, 1.0],
        [sine, cosine**2, sine, 0.0, 1.0, 0.0],
        [-sine, cosine**2, sine, 2 * sine, lobe, -1.0],
    ]
    torch.testing.assert_close(found, torch.tensor(expected))


def test_angles_turn_with_the_scene(generator):
    fibre, view = (normalize(torch.randn(50, 3, generator=generator)) for _ in range(2))
    lights = spread_directions(6)
    turn = torch.linalg.qr(torch.randn(3, 3, generator=generator))[0]
    moved = fibre_angles(fibre @ turn, view @ turn, lights @ turn)
    torch.testing.assert_close(moved, fibre_angles(fibre, view, lights), atol=1e-4, rtol=1e-4)


def test_angles_have_gradients_where_eye_or_light_look_along_the_fibre():
    fibre = torch.tensor([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]], requires_grad=True)
    lights = torch.tensor([[0.0, 1.0, 0.0]], requires_grad=True)
    fibre_angles(fibre, torch.tensor([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), lights).square().sum().backward()
    assert fibre.grad.isfinite().all()
    assert lights.grad.isfinite().all()
