"""Pictures of the suite: distances against brute force, the cut against a loop over pieces, the outline of a ball."""

import itertools

import pytest
import torch
from tiny_capture import RADIUS, ball, combed_strands

from neural_strands.evaluation.oriented_points import STEP
from neural_strands.geometry.mesh import Mesh


@pytest.fixture(scope="module")
def pictures(benchmark_module):
    return benchmark_module("quality", "suite_pictures")


@pytest.fixture(scope="module")
def head():
    surface = ball()
    return Mesh(torch.from_numpy(surface.vertices).float(), torch.from_numpy(surface.faces).long())


def distance_to_pieces(point, strands):
    """Distance of a point from the nearest straight piece of any strand."""
    start, along = strands[:, :-1].reshape(-1, 3), (strands[:, 1:] - strands[:, :-1]).reshape(-1, 3)
    share = (((point - start) * along).sum(dim=-1) / along.square().sum(dim=-1)).clamp(0, 1)
    return float((start + share[:, None] * along - point).norm(dim=-1).min())


def test_errors_are_distances_from_the_true_strands_and_end_at_the_farthest(pictures):
    truth = combed_strands(60, 12)
    moved = combed_strands(20, 7) * torch.linspace(1.0, 1.4, 20)[:, None, None]
    found = pictures.errors(moved, truth)
    expected = torch.tensor([[distance_to_pieces(point, truth) for point in strand] for strand in moved])
    assert (expected > pictures.FARTHEST).any()
    assert (expected < 0.5 * pictures.FARTHEST).any()
    # True strands are sampled at this step, so that the nearest sample is at most half of it from the nearest point.
    torch.testing.assert_close(found, expected.clamp(max=pictures.FARTHEST), atol=0.5 * STEP, rtol=0)
    assert float(pictures.errors(truth, truth).max()) < 0.5 * STEP


def test_colours_darken_with_the_distance_up_to_the_farthest(pictures):
    distance = torch.linspace(0, 1.5 * pictures.FARTHEST, 31)[None]
    colours = pictures.error_colours(distance)[0]
    # Lightness without the eye's weights for red, green and blue would not fall everywhere.
    luma = colours @ torch.tensor([0.2126, 0.7152, 0.0722])
    assert (luma[1:21] < luma[:20]).all()
    torch.testing.assert_close(colours[21:], colours[20:21].expand(10, 3))


def test_the_cut_holds_the_pieces_whose_middle_is_inside(pictures):
    strands = combed_strands(50, 9)
    found = pictures.pieces_within(strands, 0.01, 0.006)
    expected = []
    for strand in strands.tolist():
        for start, end in itertools.pairwise(strand):
            if 0.007 <= 0.5 * (start[0] + end[0]) <= 0.013:
                expected.append([start, end])
    assert 5 < len(expected) < 100
    torch.testing.assert_close(found, torch.tensor(expected))
    assert pictures.pieces_within(strands, 1.0, 0.006).shape == (0, 2, 3)


def test_the_outline_of_a_ball_is_a_circle(pictures, head):
    """At 30 mm from the centre of a ball of 90 mm, a plane cuts a circle of the root of 90² - 30² mm."""
    pieces = pictures.outline(head, 0.03)
    torch.testing.assert_close(pieces[..., 0], torch.full_like(pieces[..., 0], 0.03))
    radius = pieces[..., 1:].norm(dim=-1)
    expected = (RADIUS**2 - 0.03**2) ** 0.5
    assert float(radius.max()) <= expected + 1e-5
    assert float(radius.min()) > 0.98 * expected
    assert float((pieces[:, 1] - pieces[:, 0]).norm(dim=-1).sum()) == pytest.approx(6.2832 * expected, rel=0.01)


def test_a_cut_shows_only_the_hair_in_the_middle_of_the_head(pictures, head):
    """A strand in the plane of the cut, in front of the face, and one beside the ear."""
    line = torch.tensor([0.0, 1.0, 0.0]) * torch.linspace(-0.05, 0.05, 12)[:, None]
    middle, aside = (line + torch.tensor([x, 0.0, 0.11]) for x in (0.001, 0.05))

    def drawn(strand):
        empty = pictures.cut(torch.full((1, 2, 3), 9.0), torch.zeros(3), 0.4, head)
        changed = (pictures.cut(strand[None], torch.zeros(3), 0.4, head) != empty).any(dim=-1)
        return torch.nonzero(changed).float() / changed.shape[0] - 0.5

    assert len(drawn(aside)) == 0
    # The view is 0.4 / FILLED wide; the face is on its left. The strand is upright: one column, 0.1 m long.
    row, column = drawn(middle).T * 0.4 / pictures.FILLED
    assert float(column.max() - column.min()) < 0.002
    assert float(column.mean()) == pytest.approx(-0.11, abs=0.002)
    assert float(row.max() - row.min()) == pytest.approx(0.1, abs=0.003)


def test_few_strands_are_all_drawn_and_of_many_an_even_choice(pictures):
    many = torch.arange(12_001.0)[:, None, None].expand(-1, 2, 3)
    chosen = pictures.thinned(many)[:, 0, 0]
    assert 4000 < len(chosen) <= pictures.MOST_DRAWN
    assert set((chosen[1:] - chosen[:-1]).tolist()) == {3.0}
    assert len(pictures.thinned(many[: pictures.MOST_DRAWN])) == pictures.MOST_DRAWN


def test_rows_are_below_each_other_as_wide_as_three_views(pictures, head):
    sheet = pictures.sheet(combed_strands(), combed_strands(50) * 1.1, head)
    side, caption = pictures.SIDE, pictures.CAPTION
    assert sheet.shape == (3 * side + 3 * side // 2 + 4 * caption, 3 * side, 3)
    # The found strands, ten percent too far out, are drawn twice, in colours that differ.
    top = 2 * (side + caption)
    second, third = sheet[top - side : top], sheet[top + caption : top + caption + side]
    assert (second != third).any()
    key = sheet[top : top + caption]
    assert float(key[caption // 2].std(dim=0).min()) > 0.1
