"""What strands leave open of each pixel, and the colour of the surface behind them."""

import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.mesh import interpolate
from neural_strands.raster.openings import openings, surface_colours
from neural_strands.raster.texture import sample_bilinear
from neural_strands.raster.triangles import TriangleBuffer, rasterise_triangles


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_shares_are_counts_of_line_pixels(generator, device, factor):
    """The last row and column of line pixels belong to no whole pixel, unless there is one line pixel per pixel."""
    height, width = 4, 5
    size = (height * factor + (factor > 1), width * factor + (factor > 1))
    depth = torch.where(torch.rand(size, generator=generator) > 0.4, 1.5, torch.inf)
    segment = torch.randint(-3, 4, size, generator=generator)
    found = openings(depth.to(device), segment.to(device), factor)
    for row in range(height):
        for column in range(width):
            part = (slice(row * factor, (row + 1) * factor), slice(column * factor, (column + 1) * factor))
            is_body, is_open = depth[part].isfinite(), segment[part] < 0
            expected = [float(each.float().mean()) for each in (is_body, is_body & is_open, is_open)]
            assert [float(share[row, column]) for share in found] == pytest.approx(expected)


def seen_soup(generator, device, factor):
    """Triangles that overlap and leave gaps, and texture coordinates of their corners, some beyond the texture."""
    camera = Camera.look_at(torch.tensor([0.1, 0.2, 1.5]), torch.zeros(3), 20.0 * factor, (17 * factor, 13 * factor))
    vertices = torch.rand(60, 1, 3, generator=generator) - 0.5 + 0.2 * torch.randn(60, 3, 3, generator=generator)
    faces = torch.arange(180).view(-1, 3)
    corner_uv = 1.4 * torch.rand(60, 3, 2, generator=generator) - 0.2
    return rasterise_triangles(vertices.view(-1, 3).to(device), faces.to(device), camera), corner_uv.to(device)


def naive_colours(texture, corner_uv, seen: TriangleBuffer, factor, changes=None):
    """Colours line pixel by line pixel, in plain torch."""
    face, weights = seen.face.view(-1).clamp(min=0), seen.barycentric.view(-1, 3)
    colour = sample_bilinear(texture, interpolate(corner_uv, face, weights).to(texture))
    if changes is not None:
        factor_on, share, instead = interpolate(changes[seen.faces.long()], face, weights).split([1, 1, 3], dim=1)
        colour = torch.lerp(colour * factor_on, instead, share)
    covered = (seen.face >= 0).to(texture)
    colour = colour.view(*covered.shape, 3) * covered[..., None]
    rows, columns = (side // factor for side in covered.shape)
    total, count = (
        each.reshape(rows, factor, columns, factor, -1).sum(dim=(1, 3)) for each in (colour, covered[..., None])
    )
    return total / count.clamp(min=1)


@pytest.mark.parametrize("factor", [1, 3])
@pytest.mark.parametrize("is_changed", [False, True])
def test_colours_and_gradients_are_those_of_every_line_pixel(generator, device, factor, is_changed):
    seen, corner_uv = seen_soup(generator, device, factor)
    texture = torch.rand(9, 7, 3, generator=generator).to(device).requires_grad_()
    changes = torch.rand(180, 5, generator=generator).to(device) if is_changed else None
    found = surface_colours(texture, corner_uv, seen, factor, changes)
    expected = naive_colours(texture, corner_uv, seen, factor, changes)
    assert 0.2 < float((found > 0).float().mean()) < 0.98
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-5)
    given = torch.randn(found.shape, generator=generator).to(device)
    grads = [torch.autograd.grad(colour, texture, given)[0] for colour in (found, expected)]
    assert grads[1].abs().max() > 0.1
    torch.testing.assert_close(*grads, rtol=1e-4, atol=1e-5)


def test_a_mesh_without_faces_has_no_colour(device):
    camera = Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 20.0, (6, 4))
    nothing = torch.zeros(0, 3, device=device)
    seen = rasterise_triangles(nothing, nothing.long(), camera)
    texture = torch.ones(2, 2, 3, device=device, requires_grad=True)
    colour = surface_colours(texture, torch.zeros(0, 3, 2, device=device), seen, 2)
    assert colour.shape == (2, 3, 3)
    assert not colour.any()
    colour.sum().backward()
    assert texture.grad is not None
    assert not texture.grad.any()
