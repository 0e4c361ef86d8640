import math

import numpy as np
import pytest
import torch

from neural_strands.evaluation.consistency import consistency, consistency_reference
from neural_strands.evaluation.geometry_metrics import THRESHOLDS, fit_to_head, matched_shares, score_geometry
from neural_strands.evaluation.oriented_points import (
    STEP,
    OrientedPoints,
    sample_curves,
    sample_segments,
    sample_strands,
)
from neural_strands.geometry.line_segments import LineSegments
from neural_strands.geometry.mesh import Mesh


def curtain(rows: int = 5, columns: int = 5, gap: float = 0.01, length: float = 0.1) -> torch.Tensor:
    """Straight strands hanging down, `gap` metres apart, 20 points each."""
    x, z, y = torch.meshgrid(
        torch.arange(rows) * gap, torch.arange(columns) * gap, torch.linspace(0, -length, 20), indexing="ij"
    )
    return torch.stack([x, y, z], dim=-1).reshape(rows * columns, 20, 3)


def moved(points: torch.Tensor, x: float) -> OrientedPoints:
    return sample_strands(points + torch.tensor([x, 0.0, 0.0]))


def test_the_truth_against_itself_is_perfect():
    truth = sample_strands(curtain())
    for score in score_geometry(truth, truth):
        assert score.unsigned.as_dict() == {"precision": 100.0, "recall": 100.0, "f_score": 100.0}
        assert score.signed == score.unsigned
        assert score.strand_consistency == 100.0


def test_a_sparse_groom_shifted_by_1_5_mm_falls_between_1_and_2_mm():
    scores = score_geometry(moved(curtain(), 1.5e-3), sample_strands(curtain()))
    assert [score.unsigned.f_score for score in scores] == [0.0, 100.0, 100.0, 100.0]
    assert [score.strand_consistency for score in scores] == [0.0, 100.0, 100.0, 100.0]


def test_in_a_dense_groom_a_shifted_strand_finds_a_neighbour():
    dense = curtain(30, 3, gap=1e-3)
    strict = score_geometry(moved(dense, 1.5e-3), sample_strands(dense))[0]
    assert strict.unsigned.f_score > 90


def test_half_the_truth_has_full_precision_and_half_recall():
    truth = curtain()
    score = score_geometry(sample_strands(truth[:, :10]), sample_strands(truth))[0]
    assert score.unsigned.precision == 100.0
    # The first half and one millimetre more: 9/19 of 100 mm + 1 mm, of 201 samples 0.5 mm apart.
    assert score.unsigned.recall == pytest.approx(100 * (9 / 19 * 0.1 + 1e-3) / 0.1, abs=0.5)
    assert score.strand_consistency == pytest.approx(score.unsigned.recall, abs=1.5)


def test_reversed_strands_match_unsigned_only():
    truth = curtain()
    for score in score_geometry(sample_strands(truth.flip(1)), sample_strands(truth)):
        assert score.unsigned.f_score == 100.0
        assert score.signed.f_score == 0.0


def test_a_tilt_of_15_degrees_passes_at_20():
    truth = curtain(1, 1, length=0.01)
    angle = math.radians(15)
    rotation = torch.tensor(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]]
    )
    centre = torch.tensor([0.0, -0.005, 0.0])
    tilted = (truth - centre) @ rotation.T + centre
    shares, signed = matched_shares(sample_strands(tilted), sample_strands(truth))
    assert shares == signed == [0.0, 100.0, 100.0, 100.0]


def test_samples_are_even_and_no_farther_than_the_step():
    points = torch.rand(7, 9, 3, generator=torch.Generator().manual_seed(1)) * 0.02
    sampled = sample_strands(points)
    for strand in range(7):
        mine = sampled.curve == strand
        along = sampled.points[mine]
        assert torch.equal(sampled.step_index[mine], torch.arange(int(mine.sum())))
        torch.testing.assert_close(along[[0, -1]], points[strand, [0, -1]])
        assert (along[1:] - along[:-1]).norm(dim=-1).max() <= STEP * 1.0001
        length = float((points[strand, 1:] - points[strand, :-1]).norm(dim=-1).sum())
        assert int(mine.sum()) == math.ceil(length / STEP) + 1
    torch.testing.assert_close(sampled.directions.norm(dim=-1), torch.ones(len(sampled)))
    assert torch.equal(sampled.roots(), points[:, 0])


def test_repeated_points_and_empty_curves_do_no_harm():
    vertices = torch.tensor([[0.0, 0, 0], [0, 0, 0], [0, -1e-3, 0], [0, -1e-3, 0], [1, 1, 1], [1, 1, 1], [2, 2, 2]])
    sampled = sample_curves(vertices, torch.tensor([0, 4, 4, 6, 7]))
    assert sampled.curve.tolist() == [0, 0, 0]
    assert torch.equal(sampled.directions, torch.tensor([[0.0, -1.0, 0.0]]).expand(3, 3))
    nothing = sample_curves(vertices[:0], torch.tensor([0]))
    assert len(nothing) == 0
    score = score_geometry(nothing, sampled)[0]
    assert (score.unsigned.precision, score.unsigned.recall, score.unsigned.f_score) == (0.0, 0.0, 0.0)


def test_segments_keep_their_own_directions():
    points = torch.tensor([[0.0, 0, 0], [0, 1e-3, 0], [0.5, 0, 0]])
    directions = torch.tensor([[0.0, -1, 0], [0, -1, 0], [0, 0, 1]])
    segments = LineSegments(points, directions, torch.ones(3), torch.tensor([0, 0, 1]))
    sampled = sample_segments(segments)
    assert sampled.curve.tolist() == [0, 0, 0, 1]
    assert torch.equal(sampled.directions, directions[[0, 0, 0, 2]])
    torch.testing.assert_close(sampled.points[1], torch.tensor([0, 5e-4, 0]))


def test_consistency_equals_its_twin(generator):
    def wander(count: int) -> OrientedPoints:
        steps = torch.randn(count, 6, 3, generator=generator) * 1e-3 + torch.tensor([0, -2e-3, 0])
        return sample_strands(steps.cumsum(dim=1) + torch.rand(count, 1, 3, generator=generator) * 0.01, 1e-3)

    predicted, truth = wander(30), wander(20)
    pairs = [(threshold.distance, threshold.angle) for threshold in THRESHOLDS]
    values = consistency(predicted, truth, pairs)
    assert len(values) == len(pairs)
    for value, (distance, angle) in zip(values, pairs, strict=True):
        assert value == pytest.approx(consistency_reference(predicted, truth, distance, angle))
        assert 0 < value < 1
    # A threshold alone gives what it gives among others.
    assert [consistency(predicted, truth, [pair])[0] for pair in pairs] == values
    with pytest.raises(ValueError, match="growing"):
        consistency(predicted, truth, pairs[::-1])


def test_points_inside_a_box_and_distance_of_roots():
    vertices = torch.tensor([[x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.1)])
    faces = torch.tensor(
        [
            [0, 1, 3],
            [0, 3, 2],
            [4, 6, 7],
            [4, 7, 5],
            [0, 4, 5],
            [0, 5, 1],
            [2, 3, 7],
            [2, 7, 6],
            [0, 2, 6],
            [0, 6, 4],
            [1, 5, 7],
            [1, 7, 3],
        ]
    )
    head = Mesh(vertices, faces)
    # From 3 mm above the top face (y = 0.1), 10 mm downwards: 7 mm lie inside the box, 5 mm of them deeper than 2 mm.
    strand = torch.tensor([[[0.05, 0.103, 0.05], [0.05, 0.093, 0.05]]])
    fit = fit_to_head(sample_strands(strand), head, torch.tensor([6, 7]))
    assert fit.inside == pytest.approx(70, abs=5)
    assert fit.clearly_inside == pytest.approx(50, abs=5)
    assert fit.root_median == fit.root_largest == pytest.approx(3e-3, rel=1e-3)
    assert fit_to_head(sample_strands(strand[:0]), head) is None


def test_agrees_with_a_naive_loop(generator):
    a = sample_strands(torch.rand(6, 5, 3, generator=generator) * 0.01, 1e-3)
    b = sample_strands(torch.rand(5, 4, 3, generator=generator) * 0.01, 1e-3)
    shares, signed = matched_shares(a, b)
    for k, threshold in enumerate(THRESHOLDS):
        hits = np.zeros((2, len(a)), bool)
        for i in range(len(a)):
            for j in range(len(b)):
                if float((a.points[i] - b.points[j]).norm()) <= threshold.distance:
                    cosine = float(a.directions[i] @ b.directions[j])
                    hits[0, i] |= abs(cosine) >= math.cos(threshold.angle)
                    hits[1, i] |= cosine >= math.cos(threshold.angle)
        assert shares[k] == pytest.approx(100 * hits[0].mean())
        assert signed[k] == pytest.approx(100 * hits[1].mean())
