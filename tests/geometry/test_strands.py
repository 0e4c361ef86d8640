"""Strands: closed forms of a known polyline."""

import torch

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.strands import Strands, directions, lengths, lengths_along, segments

CORNER = torch.tensor([[[0.0, 0, 0], [0, 2, 0], [3, 2, 0]], [[1.0, 1, 1], [1, 1, 2], [1, 1, 1]]])


def test_segments_sum_to_the_whole(generator: torch.Generator):
    points = torch.randn(4, 9, 3, generator=generator, dtype=torch.float64)
    rebuilt = points[:, :1] + segments(points).cumsum(dim=1)
    torch.testing.assert_close(rebuilt, points[:, 1:])


def test_directions_and_lengths_of_a_corner():
    expected = torch.tensor([[[0.0, 1, 0], [1, 0, 0], [1, 0, 0]], [[0.0, 0, 1], [0, 0, -1], [0, 0, -1]]])
    torch.testing.assert_close(directions(CORNER), expected)
    torch.testing.assert_close(lengths(CORNER), torch.tensor([5.0, 2.0]))
    torch.testing.assert_close(lengths_along(CORNER), torch.tensor([[0.0, 2.0, 5.0], [0.0, 1.0, 2.0]]))


def test_select_keeps_attributes_together():
    strands = Strands(
        CORNER,
        root_uv=torch.tensor([[0.1, 0.2], [0.3, 0.4]]),
        width=torch.tensor([[1.0, 2, 3], [4, 5, 6]]),
        unseen=torch.tensor([0.0, 0.25]),
        t=torch.tensor([[0.0, 0.2, 0.4], [0.0, 0.5, 1.0]]),
    )
    for index in (torch.tensor([1]), torch.tensor([False, True])):
        kept = strands.select(index)
        assert len(kept) == 1
        assert kept.points_per_strand == 3
        assert torch.equal(kept.points, CORNER[1:])
        assert kept.root_uv is not None
        assert torch.equal(kept.root_uv, torch.tensor([[0.3, 0.4]]))
        assert kept.width is not None
        assert torch.equal(kept.width, torch.tensor([[4.0, 5, 6]]))
        assert kept.unseen is not None
        assert kept.unseen.tolist() == [0.25]
        assert kept.t is not None
        assert torch.equal(kept.t, torch.tensor([[0.0, 0.5, 1.0]]))
        assert kept.color is None


def test_parameters_are_evenly_spaced_unless_they_are_stored():
    assert torch.equal(Strands(CORNER).parameters(), torch.tensor([[0.0, 0.5, 1.0], [0.0, 0.5, 1.0]]))
    stored = torch.tensor([[0.0, 0.2, 0.4], [0.3, 0.5, 1.0]])
    assert torch.equal(Strands(CORNER, t=stored).parameters(), stored)


def test_to_device(device: torch.device):
    moved = Strands(CORNER, t=CORNER[..., 0]).to(device)
    assert moved.points.device.type == device.type
    assert moved.t is not None
    assert moved.t.device.type == device.type
    assert moved.width is None


def test_selected_segments_are_renumbered_without_gaps():
    identity = torch.tensor([0, 0, 1, 2, 2])
    chains = LineSegments(torch.arange(15.0).reshape(5, 3), torch.ones(5, 3), torch.ones(5), identity)
    assert chains.segment_count == 3
    kept = chains.select(torch.tensor([True, False, False, True, True]))
    assert kept.segment_id.tolist() == [0, 1, 1]
    assert kept.segment_count == 2
    assert torch.equal(kept.points, chains.points[[0, 3, 4]])
    assert chains.select(torch.zeros(5, dtype=torch.bool)).segment_count == 0
