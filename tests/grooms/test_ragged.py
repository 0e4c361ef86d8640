"""grooms.groom, the ragged struct: lengths, resampling, transforms."""

from dataclasses import replace

import pytest
import torch

from neural_strands.geometry.strands import Strands
from neural_strands.grooms.groom import ATTRIBUTES, Groom


def straight(sizes: list[int], length: float = 1.0) -> Groom:
    """Straight strands along y, unevenly spaced, width equal to the distance from the root."""
    parts = [torch.linspace(0, 1, size) ** 2 * length for size in sizes]
    along = torch.cat(parts)
    vertices = torch.stack([torch.zeros_like(along), along, torch.zeros_like(along)], dim=1)
    offsets = torch.tensor([0, *sizes]).cumsum(0)
    return Groom(vertices, offsets, width=along)


def test_lengths_of_known_lines():
    groom = straight([2, 7, 30], length=0.25)
    torch.testing.assert_close(groom.lengths(), torch.full((3,), 0.25, dtype=torch.float64), rtol=1e-6, atol=0)


def test_strands_are_equally_spaced_and_widths_follow():
    strands = straight([3, 7, 30]).strands(11)
    expected = torch.linspace(0, 1, 11).expand(3, 11)
    torch.testing.assert_close(strands.points[..., 1], expected, atol=2e-3, rtol=0)
    assert strands.width is not None
    torch.testing.assert_close(strands.width, expected, atol=2e-3, rtol=0)
    assert strands.t is None


def test_the_parameters_of_a_cut_groom_follow_its_points():
    """Points at squares of even steps, t in proportion to the arc length up to 0.6: even points have an even t."""
    groom = straight([5, 9, 30])
    groom = replace(groom, t=0.6 * groom.vertices[:, 1])
    t = groom.strands(11).t
    assert t is not None
    torch.testing.assert_close(t, torch.linspace(0, 0.6, 11).expand(3, 11), atol=2e-3, rtol=0)


def test_from_strands_and_back_keeps_everything(uniform_groom: Groom):
    strands = uniform_groom.strands(None)
    back = Groom.from_strands(strands)
    assert torch.equal(back.offsets, uniform_groom.offsets)
    for name in ("vertices", *ATTRIBUTES):
        assert torch.equal(getattr(back, name), getattr(uniform_groom, name)), name


def test_ragged_strands_need_a_count(ragged_groom: Groom):
    assert ragged_groom.uniform_size is None
    with pytest.raises(ValueError, match="say how many points"):
        ragged_groom.strands(None)
    assert ragged_groom.strands(17).points.shape == (4, 17, 3)


def test_roots_are_first_points(ragged_groom: Groom):
    assert torch.equal(ragged_groom.roots, ragged_groom.vertices[[0, 2, 11, 14]])
    torch.testing.assert_close(ragged_groom.strands(5).points[:, 0], ragged_groom.roots)


def test_transform_turns_normals_and_scales_widths(uniform_groom: Groom):
    turn = torch.tensor([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    moved = uniform_groom.transformed(turn, 2.0)
    assert moved.width is not None
    assert moved.root_normal is not None
    assert uniform_groom.width is not None
    assert uniform_groom.root_normal is not None
    x, y, z = uniform_groom.vertices.unbind(1)
    torch.testing.assert_close(moved.vertices, 2 * torch.stack([y, -x, z], dim=1))
    torch.testing.assert_close(moved.width, 2 * uniform_groom.width)
    torch.testing.assert_close(moved.root_normal.norm(dim=1), torch.ones(5))
    torch.testing.assert_close(moved.lengths(), 2 * uniform_groom.lengths(), rtol=1e-6, atol=0)


def test_shapes_that_disagree_are_a_programming_error():
    points = torch.zeros(4, 3)
    with pytest.raises(ValueError, match="offsets must run"):
        Groom(points, torch.tensor([0, 3]))
    with pytest.raises(ValueError, match="at least two points"):
        Groom(points, torch.tensor([0, 1, 4]))
    with pytest.raises(ValueError, match="root_uv: expected 2 rows"):
        Groom(points, torch.tensor([0, 2, 4]), root_uv=torch.zeros(3, 2))


def test_empty_strands_make_an_empty_groom():
    assert len(Groom.from_strands(Strands(torch.zeros(0, 100, 3)))) == 0
