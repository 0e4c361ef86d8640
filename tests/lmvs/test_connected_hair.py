"""Without masks: large masses of segments, compared with known clusters."""

import torch

from neural_strands.geometry.line_segments import LineSegments
from neural_strands.lmvs.connected_hair import large_masses


def chains(starts: torch.Tensor, count: int = 5) -> LineSegments:
    """Chains of points 1 mm apart along y."""
    along = torch.arange(count)[:, None] * torch.tensor([0.0, 1e-3, 0.0])
    points = (starts[:, None] + along).reshape(-1, 3)
    directions = torch.tensor([[0.0, 1.0, 0.0]]).repeat(len(points), 1)
    ids = torch.arange(len(starts)).repeat_interleave(count)
    return LineSegments(points, directions, torch.linspace(0, 1, len(points)), ids)


def row(first: float, count: int, gap: float) -> torch.Tensor:
    return torch.tensor([[first + gap * k, 0.0, 0.0] for k in range(count)])


def test_what_lies_apart_is_dropped_and_what_hangs_together_stays():
    # Of thirty chains the first ten lie 50 mm from the others, which are 9 mm apart from each other.
    found = chains(torch.cat([row(-0.14, 10, 0.009), row(0.0, 20, 0.009)]))
    kept = large_masses(found, 0.01, 0.6)
    assert kept.segment_count == 20
    assert len(kept) == 100
    assert torch.equal(kept.points, found.points[50:])
    assert torch.equal(kept.confidence, found.confidence[50:])
    assert torch.equal(large_masses(found, 0.01, 0.5).points, found.points)
    assert kept.segment_id.tolist() == torch.arange(20).repeat_interleave(5).tolist()


def test_what_reaches_farther_than_the_gap_joins_both():
    found = chains(torch.cat([row(-0.14, 10, 0.009), row(0.0, 20, 0.009)]))
    assert large_masses(found, 0.06, 0.6).segment_count == 30
    assert large_masses(found, 0.004, 1.0).segment_count == 30


def test_no_segments_have_no_mass():
    none = chains(row(0.0, 1, 0.1)).select(torch.zeros(5, dtype=torch.bool))
    assert len(large_masses(none, 0.01, 0.6)) == 0
