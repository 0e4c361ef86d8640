"""Colour of points: the linear decode, and what the small network adds to it."""

import pytest
import torch

from neural_strands.model.shading import CPU_BATCH, PointShading, ShadingConfig


@pytest.mark.parametrize("hidden", [0, 8])
def test_it_starts_as_a_linear_decode_of_the_feature(hidden, generator):
    shading = PointShading(5, ShadingConfig(hidden), generator)
    descriptor, view = torch.randn(20, 9, generator=generator), torch.randn(20, 3, generator=generator)
    with torch.no_grad():
        shading.mean.copy_(torch.tensor([0.1, 0.2, 0.3]))
    torch.testing.assert_close(shading(descriptor, view), descriptor[:, :5] @ shading.decode.T + shading.mean)


def test_the_network_sees_direction_t_and_view(generator):
    shading = PointShading(5, ShadingConfig(), generator)
    with torch.no_grad():
        shading.outer.normal_(generator=generator)
    descriptor = torch.randn(4, 9, generator=generator, requires_grad=True)
    view = torch.randn(4, 3, generator=generator, requires_grad=True)
    shading(descriptor, view).square().sum().backward()
    assert (descriptor.grad.abs() > 0).all()
    assert (view.grad.abs() > 0).all()


def test_no_points_have_no_colour(generator):
    shading = PointShading(5, ShadingConfig(), generator)
    assert shading(torch.zeros(0, 9), torch.zeros(0, 3)).shape == (0, 3)


def test_batches_of_points_change_nothing(generator):
    """More points than one batch, against each point shaded with the few beside it."""
    shading = PointShading(5, ShadingConfig(8), generator)
    with torch.no_grad():
        shading.outer.normal_(generator=generator)
        shading.mean.normal_(generator=generator)
    points = CPU_BATCH + 3
    descriptor = torch.randn(points, 9, generator=generator, requires_grad=True)
    view = torch.randn(points, 3, generator=generator)
    together = shading(descriptor, view)
    apart = torch.cat([shading(*part) for part in zip(descriptor.split(1000), view.split(1000), strict=True)])
    torch.testing.assert_close(together, apart)
    weights = [shading.outer, shading.decode, shading.mean, *shading.inner]
    for one, other in zip(
        *(torch.autograd.grad(found.square().sum(), weights) for found in (together, apart)), strict=True
    ):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-3)


def test_its_sum_in_closed_form(generator):
    """Colour c is mean_c + decode_c . z + response_c . [1, z], the response being the network's."""
    shading = PointShading(2, ShadingConfig(4, 1), generator)
    with torch.no_grad():
        shading.outer.normal_(generator=generator)
        shading.mean.normal_(generator=generator)
    descriptor, view = torch.randn(3, 6, generator=generator), torch.randn(3, 3, generator=generator)
    found = shading(descriptor, view)
    for point, direction, colour in zip(descriptor, view, found, strict=True):
        along = point[2:5] @ direction
        seen = torch.cat([point, direction, along[None], 1 - along[None] ** 2])
        hidden = torch.nn.functional.silu(shading.inner[0] @ seen + shading.biases[0])
        response = (shading.outer @ hidden).view(3, 3)
        own = torch.cat([torch.ones(1), point[:2]])
        torch.testing.assert_close(colour, shading.mean + shading.decode @ point[:2] + response @ own)
