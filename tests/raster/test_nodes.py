"""Nodes of visible points against the definitions, with plain Python and NumPy."""

import math

import numpy as np
import pytest
import torch

from neural_strands.geometry.cameras import Camera
from neural_strands.geometry.strands import directions
from neural_strands.raster.lines import LineConfig, rasterise_lines
from neural_strands.raster.nodes import visible_nodes
from neural_strands.raster.visible import DENSE, STRAIGHT, STRIDE, visible_points

POINTS = 33 * STRIDE + 1
"""Points of a strand, of which every third is a node."""


@pytest.fixture
def camera():
    return Camera.look_at(torch.tensor([0.0, 0.0, 1.0]), torch.zeros(3), 120.0, (48, 40))


def strands(count, bend, points=POINTS):
    """Arcs in the image plane that turn by `bend` radians at every point."""
    start = torch.linspace(-0.12, 0.12, count)
    angle = 0.3 + bend * torch.arange(points - 1)
    step = 0.2 / points * torch.stack([angle.sin(), angle.cos(), torch.zeros(points - 1)], dim=1)
    line = torch.cat([torch.zeros(1, 3), step.cumsum(dim=0)]) - torch.tensor([0.0, 0.1, 0.0])
    offset = torch.stack([start, torch.zeros(count), torch.zeros(count)], dim=1)
    return line + offset[:, None]


def seen(points, camera, factor=2):
    fine = camera.resized(camera.width * factor, camera.height * factor)
    return visible_points(rasterise_lines(points, fine, config=LineConfig(width=0.004)), points, factor)


@pytest.mark.parametrize(("bend", "stride"), [(0.1, STRIDE), (0.2, 1)])
def test_every_third_point_of_a_straight_strand_is_a_node_and_every_point_of_a_curl(camera, device, bend, stride):
    assert STRIDE == 3
    assert math.cos(2 * 0.2) < STRAIGHT < math.cos(2 * 0.1)
    points = strands(20, bend).to(device)
    visible = seen(points, camera.to(device))
    nodes = visible_nodes(visible, points)
    vertex, strand = nodes.vertex[nodes.before], nodes.strand[nodes.before]
    assert len(visible) > 200
    assert torch.equal(strand, visible.strand)
    assert torch.equal(vertex, visible.vertex // stride * stride)
    assert torch.equal(nodes.strand[nodes.before + 1], visible.strand)
    assert torch.equal(nodes.vertex[nodes.before + 1], vertex + stride)
    expected = (visible.vertex + visible.position - vertex) / stride
    torch.testing.assert_close(nodes.along, expected, rtol=0, atol=1e-5)
    if torch.device(device).type == "cpu":
        wanted = {(int(s), int(v) + k) for s, v in zip(strand, vertex, strict=True) for k in (0, stride)}
        assert list(zip(nodes.strand.tolist(), nodes.vertex.tolist(), strict=True)) == sorted(wanted)


def test_a_strand_of_few_points_has_a_node_at_each(camera):
    points = strands(20, 0.0, DENSE - 1)
    nodes, visible = visible_nodes(seen(points, camera), points), seen(points, camera)
    assert torch.equal(nodes.vertex[nodes.before], visible.vertex)
    torch.testing.assert_close(nodes.along, visible.position)


def test_the_last_piece_ends_at_the_tip(camera):
    """Of 100 segments the last piece has one."""
    points = strands(20, 0.0, POINTS + 1)
    visible = seen(points, camera, 8)
    nodes = visible_nodes(visible, points)
    assert int(visible.vertex.max()) == POINTS - 1
    assert int(nodes.vertex.max()) == POINTS
    last = visible.vertex == POINTS - 1
    torch.testing.assert_close(nodes.along[last], visible.position[last], rtol=0, atol=1e-5)


def test_values_that_change_evenly_along_a_strand_are_exact(camera, device):
    points = strands(20, 0.05).to(device)
    visible = seen(points, camera.to(device))
    nodes = visible_nodes(visible, points)
    blended = nodes.blend(torch.stack([nodes.vertex.float(), 100.0 * nodes.strand], dim=1))
    expected = torch.stack([visible.vertex + visible.position, 100.0 * visible.strand], dim=1)
    torch.testing.assert_close(blended, expected, rtol=0, atol=1e-3)


def test_values_and_gradients_of_a_blend_are_those_of_numpy(camera, generator):
    points = strands(20, 0.15)
    nodes = visible_nodes(seen(points, camera), points)
    values = torch.randn(len(nodes), 7, generator=generator).requires_grad_()
    cotangent = torch.randn(len(nodes.before), 7, generator=generator)
    found = nodes.blend(values)
    (gradient,) = torch.autograd.grad(found, values, cotangent)
    given, before, share = values.detach().numpy(), nodes.before.numpy(), nodes.along.numpy()[:, None]
    np.testing.assert_allclose(
        found.detach().numpy(), (1 - share) * given[before] + share * given[before + 1], rtol=0, atol=1e-6
    )
    expected = np.zeros_like(given)
    np.add.at(expected, before, (1 - share) * cotangent.numpy())
    np.add.at(expected, before + 1, share * cotangent.numpy())
    np.testing.assert_allclose(gradient.numpy(), expected, rtol=0, atol=1e-4)
    torch.testing.assert_close(nodes.blend_reference(values), found)
    assert nodes.blend(values.double()).dtype == torch.float64


def test_positions_and_directions_are_those_of_the_strands(camera, generator):
    points = strands(20, 0.15) + 0.001 * torch.randn(20, POINTS, 3, generator=generator)
    nodes = visible_nodes(seen(points, camera), points)
    assert int(nodes.vertex.max()) == POINTS - 1
    assert torch.equal(nodes.positions(points), points[nodes.strand, nodes.vertex])
    torch.testing.assert_close(nodes.directions(points), directions(points)[nodes.strand, nodes.vertex])


def test_where_nothing_is_seen_there_are_no_nodes(camera):
    points = strands(3, 0.0) + torch.tensor([5.0, 0.0, 0.0])
    nodes = visible_nodes(seen(points, camera), points)
    assert len(nodes) == len(nodes.before) == 0
    assert nodes.blend(torch.zeros(0, 4)).shape == (0, 4)


@pytest.mark.parametrize("count", [DENSE, 101, 201])
def test_nodes_lie_at_the_same_points_whatever_follows(camera, count):
    """Hair that is cut shorter keeps its nodes."""
    points = strands(20, 0.05, count)
    nodes = visible_nodes(seen(points, camera), points)
    inner = nodes.vertex[nodes.vertex < count - 1]
    assert len(inner) > 100
    assert not (inner % STRIDE).any()
