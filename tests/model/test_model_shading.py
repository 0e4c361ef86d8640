"""Colour of points: the linear decode, and what the small network adds to it."""

import pytest
import torch

from neural_strands.model.shading import PointShading, ShadingConfig


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
